"""The ground near the vehicle in one key frame, and its depth in a camera."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from coin3d.datasets.frame import Frame
from coin3d.datasets.ground_fit import fit_ground
from coin3d.geometry import Camera, GroundPlane
from coin3d.scenes.views import pixel_rays_ego

_MIN_INLIER_SHARE = 0.5
_MAX_OFFSET_M = 0.5


def local_ground(frame: Frame) -> GroundPlane:
    """The plane of the street under the vehicle: fitted to the LiDAR where that is well supported, else the rig's."""
    if frame.lidar is None:
        return frame.rig.ground
    scan = frame.lidar.load()
    fit = fit_ground(scan.points_ego, scan.origin_ego)
    under_ego = np.zeros(3)
    if fit is None or fit.inlier_share < _MIN_INLIER_SHARE:
        return frame.rig.ground
    apart_m = abs(float(fit.plane.height_m(under_ego)) - float(frame.rig.ground.height_m(under_ego)))
    return fit.plane if apart_m < _MAX_OFFSET_M else frame.rig.ground


def plane_depth(camera: Camera, plane: GroundPlane) -> Float[np.ndarray, "h w"]:
    """Depth at which the rays through the pixels meet a plane of the ego frame, infinite at and above its horizon."""
    sinking = -(pixel_rays_ego(camera) @ plane.normal)
    height_m = float(plane.height_m(camera.ego_from_cam.translation))
    with np.errstate(divide="ignore"):
        return np.where(sinking > 0, height_m / sinking, np.inf)
