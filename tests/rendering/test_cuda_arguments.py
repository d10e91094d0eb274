"""What gsplat is asked for, without a GPU: a stand-in rasteriser looks at its arguments."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch

from coin3d.geometry import Camera, camera_pose
from coin3d.rendering import Gaussians, render
from coin3d.rendering.cuda import render_with


def camera(width: int, yaw_rad: float, skew: float = 0) -> Camera:
    return Camera(np.array([[30.0, skew, 7], [0, 31, 5], [0, 0, 1]]), width, 8, camera_pose([1, 2, 1.5], yaw_rad))


def two_gaussians() -> Gaussians:
    centre = np.array([[4, 0, 1], [5, 1, 2]], np.float32)
    return Gaussians(centre, np.array([0.1, 0.2], np.float32), np.array([[255, 0, 51]] * 2, np.uint8))


def test_cameras_of_one_size_share_a_call_and_results_keep_their_order() -> None:
    calls: list[dict[str, Any]] = []

    def rasterize(**given: Any) -> tuple[torch.Tensor, torch.Tensor, None]:
        calls.append(given)
        shape = (len(given["Ks"]), given["height"], given["width"])
        rgbd = torch.stack([torch.full(shape, v) for v in (1.5, 0.2, 0.0, 7.0)], -1)
        return rgbd * (given["viewmats"][:, :1, 3, None, None] * 0 + 1), torch.full((*shape, 1), given["width"] / 100), None

    cameras = [camera(10, 0), camera(12, 1), camera(10, 2)]
    images = render_with(rasterize, two_gaussians(), cameras, torch.device("cpu"))
    assert [len(c["Ks"]) for c in calls] == [2, 1] and [c["width"] for c in calls] == [10, 12]
    first = calls[0]
    np.testing.assert_allclose(
        first["viewmats"][1] @ torch.tensor(cameras[2].ego_from_cam.matrix).float(), np.eye(4), atol=1e-6
    )
    np.testing.assert_allclose(first["Ks"][0], cameras[0].K)
    assert first["scales"].shape == (2, 3) and first["scales"][1, 2] == pytest.approx(0.2)
    assert first["quats"].shape == (2, 4) and first["opacities"].tolist() == [1, 1]
    np.testing.assert_allclose(first["colors"][0], [1, 0, 0.2])
    assert (first["eps2d"], first["render_mode"]) == (0.3, "RGB+D") and first["near_plane"] == pytest.approx(0.2)
    assert [i.rgb.shape for i in images] == [(8, 10, 3), (8, 12, 3), (8, 10, 3)]
    assert images[0].rgb[0, 0].tolist() == [255, 51, 0] and images[1].depth_m[3, 4] == 7
    assert images[1].alpha[0, 0] == pytest.approx(0.12)


def test_skewed_images_are_refused() -> None:
    with pytest.raises(ValueError, match="camera 0 has a skewed"):
        render_with(lambda **_: pytest.fail("called"), two_gaussians(), [camera(10, 0, skew=1)], torch.device("cpu"))


def test_without_gsplat_or_a_gpu_the_message_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gsplat", None)
    with pytest.raises(ImportError, match="pip install gsplat"):
        render(two_gaussians(), [camera(10, 0)], device="cuda")
    stand_in = ModuleType("gsplat")
    stand_in.rasterization = None  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "gsplat", stand_in)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(RuntimeError, match="render with device='cpu'"):
        render(two_gaussians(), [camera(10, 0)], device="cuda")
