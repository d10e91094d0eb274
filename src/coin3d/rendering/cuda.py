"""Rendering by gsplat (Apache-2.0) on a CUDA device. Untested on a GPU: tests only check what gsplat is asked for.

gsplat clamps alpha at its own 0.999 instead of 0.99 and cuts splats off at three standard deviations, so pictures differ
slightly from those of the CPU.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch

from coin3d.geometry import Camera
from coin3d.rendering.gaussians import Gaussians
from coin3d.rendering.view import BLUR_PX2, NEAR_M, Rendering, require_pinhole

Rasterize = Callable[..., tuple[torch.Tensor, torch.Tensor, Any]]


def render_cuda(gaussians: Gaussians, cameras: Sequence[Camera]) -> list[Rendering]:
    """Render one image per camera on the current CUDA device.

    Raises:
        ImportError: gsplat is not installed.
        RuntimeError: there is no CUDA device.
        ValueError: a camera that gsplat cannot express.
    """
    try:
        from gsplat import rasterization
    except ImportError as error:
        raise ImportError("rendering on a GPU needs gsplat: pip install gsplat; or render on the CPU") from error
    if not torch.cuda.is_available():
        raise RuntimeError("rendering with device='cuda' needs a CUDA device and there is none; render with device='cpu'")
    return render_with(rasterization, gaussians, cameras, torch.device("cuda"))


def render_with(rasterize: Rasterize, gaussians: Gaussians, cameras: Sequence[Camera], device: torch.device) -> list[Rendering]:
    """Render with a function that has the interface of ``gsplat.rasterization``; cameras of one size share a call."""
    require_pinhole(cameras)
    for i, camera in enumerate(cameras):
        K = camera.K
        if K[0, 1] != 0 or K[1, 0] != 0 or K[0, 0] <= 0 or K[1, 1] <= 0:
            raise ValueError(f"camera {i} has a skewed, turned or flipped image, which gsplat cannot render; use the CPU")
    n = len(gaussians)
    scene = {
        "means": torch.tensor(gaussians.centre_m, device=device),
        "quats": torch.tensor([1.0, 0, 0, 0], device=device).expand(n, 4),
        "scales": torch.tensor(gaussians.std_m, device=device)[:, None].expand(n, 3),
        "opacities": torch.ones(n, device=device),
        "colors": torch.tensor(gaussians.rgb, device=device).float() / 255,
    }
    images: dict[int, Rendering] = {}
    for size in {(c.width_px, c.height_px): None for c in cameras}:
        group = [i for i, c in enumerate(cameras) if (c.width_px, c.height_px) == size]
        cam_from_ego = np.stack([cameras[i].ego_from_cam.inverse().matrix for i in group])
        colours, alpha, _ = rasterize(
            **scene,
            viewmats=torch.tensor(cam_from_ego, dtype=torch.float32, device=device),
            Ks=torch.tensor(np.stack([cameras[i].K for i in group]), dtype=torch.float32, device=device),
            width=size[0],
            height=size[1],
            near_plane=NEAR_M,
            eps2d=BLUR_PX2,
            render_mode="RGB+D",
        )
        for i, rgbd, a in zip(group, colours.cpu(), alpha.cpu(), strict=True):
            rgb = (rgbd[..., :3].clamp(0, 1) * 255).round().to(torch.uint8)
            images[i] = Rendering(rgb.numpy(), rgbd[..., 3].contiguous().numpy(), a[..., 0].contiguous().numpy())
    return [images[i] for i in range(len(cameras))]
