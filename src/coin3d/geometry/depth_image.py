"""Points as a camera's depth image."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from coin3d.geometry.camera import Camera


def nearest_depth(points_ego: Float[np.ndarray, "n 3"], camera: Camera) -> Float[np.ndarray, "h w"]:
    """Depth (m, along the optical axis) of the nearest point in each pixel, infinite where no point falls."""
    pixels, depth_m = camera.project(points_ego)
    seen = camera.in_image(pixels, depth_m)
    u, v = np.floor(pixels[seen]).astype(np.int64).T
    nearest = np.full(camera.height_px * camera.width_px, np.inf, dtype=np.float32)
    np.minimum.at(nearest, v * camera.width_px + u, depth_m[seen].astype(np.float32))
    return nearest.reshape(camera.height_px, camera.width_px)
