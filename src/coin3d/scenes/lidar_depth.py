"""Depth of a key frame's own LiDAR returns in a camera."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float

from coin3d.geometry import Camera
from coin3d.geometry.depth_image import nearest_depth

# a return this much farther than one beside it was seen past an edge by the higher LiDAR, not by the camera
_HIDDEN_BEHIND = 1.1
_BESIDE = 1 / 80  # of the image width


def lidar_depth(points_ego: Float[np.ndarray, "n 3"], camera: Camera) -> Float[np.ndarray, "h w"]:
    """Depth of the nearest return per pixel, 0 where there is none; returns that the camera cannot see are left out.

    The LiDAR stands higher than the cameras and looks over objects, so a return is dropped where another one within a
    few pixels is more than a tenth nearer.

    Args:
        points_ego: returns in the ego frame.
        camera: any camera in the ego frame.
    """
    nearest = nearest_depth(points_ego, camera)
    side = 2 * max(1, round(camera.width_px * _BESIDE / 2)) + 1
    around = cv2.erode(nearest, np.ones((side, side), dtype=np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=np.inf)
    return np.where(np.isfinite(nearest) & (nearest <= _HIDDEN_BEHIND * around), nearest, np.float32(0))
