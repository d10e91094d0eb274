"""What every renderer needs of a camera, what it returns, and the constants of the definition."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, UInt8

from coin3d.geometry import Camera, Pinhole

NEAR_M = float(np.float32(0.2))
"""Gaussians whose centre is not farther than this from the camera plane are not drawn."""
BLUR_PX2 = 0.3
"""Added to both variances on screen: a splat is never thinner than a pixel."""
MAX_ALPHA = float(np.float32(0.99))
"""A single-precision number on purpose: two such splats leave less than MIN_TRANSMITTANCE, and so a pixel stops."""
MIN_ALPHA = 1 / 255
MIN_TRANSMITTANCE = 1e-4


@dataclass(frozen=True, eq=False)
class Rendering:
    """One rendered image. Depth and alpha are sums over splats of alpha T z and alpha T, not normalised: z is depth / alpha.

    Args:
        rgb: (h, w, 3) colours over black.
        depth_m: (h, w) metres along the optical axis, times alpha.
        alpha: (h, w) in [0, 1]; 0 where nothing was drawn.
    """

    rgb: UInt8[np.ndarray, "h w 3"]
    depth_m: Float32[np.ndarray, "h w"]
    alpha: Float32[np.ndarray, "h w"]


@dataclass(frozen=True)
class SlopeLimits:
    """Range of x / z and of y / z at which the projection is linearised; outside it the nearest limit is used."""

    x_min: float
    x_max: float
    y_min: float
    y_max: float


def slope_limits(camera: Camera) -> SlopeLimits:
    """The camera's own frustum, widened on each side by 15 % of its width.

    For a principal point in the middle this is the usual limit of 1.3 tan(fov / 2); gsplat uses the same for other principal
    points. A rotated or skewed image counts with the rectangle around its corners.
    """
    corners = np.array([[u, v] for u in (0, camera.width_px) for v in (0, camera.height_px)], dtype=np.float64)
    plane = camera.rays_cam(corners)[:, :2]
    low, high = plane.min(0), plane.max(0)
    margin = 0.15 * (high - low)
    return SlopeLimits(low[0] - margin[0], high[0] + margin[0], low[1] - margin[1], high[1] + margin[1])


def require_pinhole(cameras: Sequence[Camera]) -> None:
    """Refuse cameras with another lens.

    Raises:
        ValueError: the position of the camera in the list and its lens.
    """
    for i, camera in enumerate(cameras):
        if not isinstance(camera.lens, Pinhole):
            raise ValueError(
                f"camera {i} of {len(cameras)} has the lens {camera.lens}; Gaussians are rendered through pinhole cameras "
                "only: render with a Pinhole lens and distort the picture afterwards"
            )
