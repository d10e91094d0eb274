"""How good the Gaussians of a key frame are, from what the builder itself knows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from coin3d.geometry import GroundPlane
from coin3d.rendering import Gaussians, render
from coin3d.scenes.ground import plane_depth
from coin3d.scenes.seen_view import FROM_COMPLETION, FROM_LIDAR, FROM_MESH, FROM_SKY, OF_OWN_VEHICLE, SeenView

_EMPTY_ALPHA = 0.5


@dataclass(frozen=True)
class FrameQuality:
    """Figures of one frame; shares are of all pixels of its images. The own vehicle is left out of the last three.

    Args:
        token: of the frame.
        gaussians: their number.
        mesh: share of pixels with depth of the meshes.
        lidar: of the frame's own LiDAR.
        completed: completed.
        sky: put at the distance of the sky.
        known_below_horizon: share with measured depth, of the pixels below the horizon.
        psnr_db: of the frame's own images rendered from the Gaussians, mean over the images.
        empty_below_horizon: share of rendered pixels below the horizon with alpha under 0.5.
    """

    token: str
    gaussians: int
    mesh: float
    lidar: float
    completed: float
    sky: float
    known_below_horizon: float
    psnr_db: float
    empty_below_horizon: float


def frame_quality(token: str, gaussians: Gaussians, views: Sequence[SeenView], ground: GroundPlane) -> FrameQuality:
    """Render the frame's own cameras and count."""
    source = np.concatenate([view.source.reshape(-1) for view in views])
    below = np.concatenate([np.isfinite(plane_depth(view.camera, ground)).reshape(-1) for view in views])
    below &= source != OF_OWN_VEHICLE
    rendered = render(gaussians, [view.camera for view in views])
    alpha = np.concatenate([image.alpha.reshape(-1) for image in rendered])
    scene = [view.source != OF_OWN_VEHICLE for view in views]
    psnr_db = [_psnr_db(image.rgb[s], v.rgb[s]) for image, v, s in zip(rendered, views, scene, strict=True) if s.any()]
    measured = (source == FROM_MESH) | (source == FROM_LIDAR)

    def share(kind: int) -> float:
        return round(float((source == kind).mean()), 5)

    return FrameQuality(
        token,
        len(gaussians),
        mesh=share(FROM_MESH),
        lidar=share(FROM_LIDAR),
        completed=share(FROM_COMPLETION),
        sky=share(FROM_SKY),
        known_below_horizon=round(float(measured[below].mean()), 5) if below.any() else 0.0,
        psnr_db=round(float(np.mean(psnr_db)), 3) if psnr_db else 0.0,
        empty_below_horizon=round(float((alpha[below] < _EMPTY_ALPHA).mean()), 5) if below.any() else 0.0,
    )


def _psnr_db(rendered: UInt8[np.ndarray, "n 3"], image: UInt8[np.ndarray, "n 3"]) -> float:
    error = np.square(rendered.astype(np.float32) - image).mean()
    return float(10 * np.log10(255**2 / max(float(error), 1e-6)))
