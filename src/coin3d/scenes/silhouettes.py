"""Silhouettes of fused surfaces, moved to where the image has its edges.

A mesh of 0.1 m voxels sticks out over the true edge by about one voxel, several pixels of a near object. Those pixels
show what is behind, and at the mesh's depth they would float as a painted rim beside the object.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from coin3d.scenes.backing import continue_behind
from coin3d.scenes.smooth_fill import smooth_fill

_WIDEST_SHARE = 1 / 40  # of the image width
_SAME_SURFACE = 1.1


@dataclass(frozen=True, eq=False)
class Trimmed:
    """Depth with moved silhouettes.

    Args:
        depth_m: (h, w).
        moved: (h, w) pixels that now have the depth of what is behind.
    """

    depth_m: Float[np.ndarray, "h w"]
    moved: Bool[np.ndarray, "h w"]


def trim_silhouettes(
    rgb: UInt8[np.ndarray, "h w 3"],
    depth_m: Float[np.ndarray, "h w"],
    meshed: Bool[np.ndarray, "h w"],
    exact: Bool[np.ndarray, "h w"],
    focal_px: float,
    overhang_m: float,
) -> Trimmed:
    """Let the image decide, near every step of depth, which mesh pixels belong to what is behind.

    The rim of a surface is taken out and filled again from its inside and from the far side, along the image's edges; a
    pixel that comes out nearer to the far side moves there. Surfaces so thin that nothing but rim would be left stay.

    Args:
        rgb: the image.
        depth_m: depth of every pixel.
        meshed: which of them are the depth of a mesh.
        exact: pixels with a LiDAR return that agrees: they are never moved.
        focal_px: of the camera.
        overhang_m: how far surfaces stick out.
    """
    widest = max(2, round(rgb.shape[1] * _WIDEST_SHARE))
    behind = continue_behind(depth_m, rgb, widest)
    width = np.clip(np.rint(overhang_m * focal_px / depth_m), 1, widest)
    rim = meshed & behind.mask & (behind.distance_px <= width) & ~exact
    window = np.ones((2 * widest + 3, 2 * widest + 3), dtype=np.uint8)
    inside = cv2.erode(
        np.where(rim | ~meshed, np.float32(1e9), depth_m), window, borderType=cv2.BORDER_CONSTANT, borderValue=1e9
    )
    rim &= inside < _SAME_SURFACE * depth_m
    if not rim.any():
        return Trimmed(depth_m, rim)
    inverse = (1 / depth_m).astype(np.float32)
    nowhere = np.zeros_like(rim)
    weight = np.full(rim.shape, 1e-6, dtype=np.float32)
    filled = smooth_fill(inverse, ~rim, nowhere, rgb.astype(np.float32) / 255, inverse, weight)
    moved = rim & (filled < (inverse + 1 / behind.depth_m) / 2)
    return Trimmed(np.where(moved, behind.depth_m, depth_m).astype(np.float32), moved)
