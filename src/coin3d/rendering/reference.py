"""The definition of the renderer in float64, one splat at a time over the whole image. Slow and meant to be read.

Splats are those of 3D Gaussian splatting (Kerbl et al. 2023) with isotropic covariance, opacity 1 and plain colours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from coin3d.geometry import Camera
from coin3d.rendering.gaussians import Gaussians
from coin3d.rendering.view import (
    BLUR_PX2,
    MAX_ALPHA,
    MIN_ALPHA,
    MIN_TRANSMITTANCE,
    NEAR_M,
    require_pinhole,
    slope_limits,
)


@dataclass(frozen=True, eq=False)
class ExactRendering:
    """As ``Rendering``, in float64 and without rounding to 8 bits.

    Args:
        rgb: (h, w, 3) in [0, 1].
        depth_m: (h, w) sum of alpha T z.
        alpha: (h, w) sum of alpha T.
    """

    rgb: Float[np.ndarray, "h w 3"]
    depth_m: Float[np.ndarray, "h w"]
    alpha: Float[np.ndarray, "h w"]


@dataclass(frozen=True, eq=False)
class _Splats:
    """M Gaussians on the image, front to back."""

    pixel: Float[np.ndarray, "m 2"]
    precision: Float[np.ndarray, "m 2 2"]
    depth_m: Float[np.ndarray, "m"]
    rgb: Float[np.ndarray, "m 3"]


def render_reference(gaussians: Gaussians, camera: Camera) -> ExactRendering:
    """Render one image."""
    require_pinhole([camera])
    splats = _project(gaussians, camera)
    pixels = camera.pixel_grid()
    transmittance = np.ones(pixels.shape[:2])
    open_ = np.ones(pixels.shape[:2], dtype=bool)
    rgb, depth_m = np.zeros((*open_.shape, 3)), np.zeros(open_.shape)
    for k in range(len(splats.depth_m)):
        offset = pixels - splats.pixel[k]
        q = ((offset @ splats.precision[k]) * offset).sum(-1)
        alpha = np.minimum(MAX_ALPHA, np.exp(-q / 2))
        remaining = transmittance * (1 - alpha)
        drawn = open_ & (alpha >= MIN_ALPHA)
        open_ &= ~(drawn & (remaining < MIN_TRANSMITTANCE))  # a pixel stops before the splat that would darken it too far
        drawn &= open_
        weight = np.where(drawn, alpha * transmittance, 0)
        rgb += weight[..., None] * splats.rgb[k]
        depth_m += weight * splats.depth_m[k]
        transmittance = np.where(drawn, remaining, transmittance)
    return ExactRendering(rgb, depth_m, 1 - transmittance)


def _project(gaussians: Gaussians, camera: Camera) -> _Splats:
    points_cam = camera.ego_from_cam.inverse().apply(gaussians.centre_m)
    rows = np.flatnonzero(points_cam[:, 2] > NEAR_M)
    rows = rows[np.argsort(points_cam[rows, 2], kind="stable")]  # equal depth: the smaller row is in front
    x, y, z = points_cam[rows].T
    limits = slope_limits(camera)
    slope_x, slope_y = np.clip(x / z, limits.x_min, limits.x_max), np.clip(y / z, limits.y_min, limits.y_max)
    zero, one = np.zeros_like(z), np.ones_like(z)
    derivative = np.stack([np.stack([one, zero, -slope_x], -1), np.stack([zero, one, -slope_y], -1)], -2) / z[:, None, None]
    jacobian = camera.K[:2, :2] @ derivative
    variance = gaussians.std_m[rows].astype(np.float64) ** 2
    covariance = variance[:, None, None] * jacobian @ jacobian.transpose(0, 2, 1) + BLUR_PX2 * np.eye(2)
    pixel = np.stack([x / z, y / z], -1) @ camera.K[:2, :2].T + camera.K[:2, 2]
    return _Splats(pixel, np.linalg.inv(covariance), z, gaussians.rgb[rows] / 255)
