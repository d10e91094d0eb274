"""The prior maps once more, written the long way in float64 numpy: the oracle the fast maps are tested against."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from coin3d.geometry import Camera, GroundPlane
from coin3d.priors.maps import GROUND_DEPTH_SCALE_M, GROUND_GRADIENT_SCALE, PriorOptions


def reference_maps(camera: Camera, ground: GroundPlane, options: PriorOptions | None = None) -> Float[np.ndarray, "9 h w"]:
    """The nine channels of one pinhole camera: shoot a ray through every pixel and meet the ground with it."""
    options = options or PriorOptions()
    pixels = camera.pixel_grid()
    origin = camera.ego_from_cam.translation
    rays = camera.rays_ego(pixels)
    depth = ground_depth_m(camera, ground, pixels, options.ground_cap_m)
    depth_above = ground_depth_m(camera, ground, pixels - (0, 1), options.ground_cap_m)
    with np.errstate(invalid="ignore", divide="ignore"):
        growth = depth_above - depth
        gradient = np.where(growth > 0, np.log(1 / growth + 1), 0.0)
    focal_ratio = options.focal_for_width_px(camera.width_px) / camera.focal_px
    return np.concatenate(
        [
            np.full((1, *depth.shape), focal_ratio**2),
            np.nan_to_num(depth)[None] / GROUND_DEPTH_SCALE_M,
            gradient[None] / GROUND_GRADIENT_SCALE,
            np.moveaxis(rays, -1, 0),
            np.moveaxis(np.cross(origin, rays), -1, 0),
        ]
    )


def ground_depth_m(
    camera: Camera, ground: GroundPlane, pixels: Float[np.ndarray, "... 2"], cap_m: float = 60.0
) -> Float[np.ndarray, "..."]:
    """Camera depth z of the ground at pixels; NaN where the ray misses it, or meets it behind the camera or past the cap."""
    height_m = ground.height_m(camera.ego_from_cam.translation)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = -height_m / (camera.rays_ego(pixels) @ ground.normal)
        return np.where((height_m > 0) & (depth > 0) & (depth <= cap_m), depth, np.nan)
