"""Complete the holes of mesh depth to dense depth (spec official_code 4, step 2.2).

A learned model plugs in as any callable with the signature of ``DepthCompletion``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from coin3d.geometry import Camera, GroundPlane
from coin3d.scenes.ground import plane_depth
from coin3d.scenes.smooth_fill import smooth_fill

_RIM_SHARE = 1 / 200  # of the image width


@runtime_checkable
class DepthCompletion(Protocol):
    """From an image and the depth that is known to depth everywhere."""

    def __call__(
        self,
        rgb: UInt8[np.ndarray, "h w 3"],
        sparse_depth_m: Float[np.ndarray, "h w"],
        sky: Bool[np.ndarray, "h w"],
        camera: Camera,
        ground: GroundPlane,
    ) -> Float[np.ndarray, "h w"]:
        """Depth of every pixel.

        Args:
            rgb: the image.
            sparse_depth_m: known depth along the optical axis, 0 where unknown.
            sky: pixels whose answer is not used.
            camera: of the image, in the ego frame.
            ground: the street near the vehicle.

        Returns:
            Positive, finite depth; known pixels are overwritten by their known depth afterwards.
        """
        ...


@dataclass(frozen=True)
class EdgeAwareCompletion:
    """Inverse depth as smooth as the image allows.

    Inverse depth is affine in the image on every plane, and constant along the columns of an upright wall, so extending
    it smoothly continues streets and walls; it may step only where colours do. The ground is drawn to its plane near
    the vehicle, and nothing lies under it.

    Args:
        max_depth_m: no completed depth is farther.
        ground_reach_m: the plane of the ground is trusted so far away.
        ground_pull: weight of the ground against that of one neighbouring pixel.
    """

    max_depth_m: float = 120.0
    ground_reach_m: float = 25.0
    ground_pull: float = 0.02

    def __call__(
        self,
        rgb: UInt8[np.ndarray, "h w 3"],
        sparse_depth_m: Float[np.ndarray, "h w"],
        sky: Bool[np.ndarray, "h w"],
        camera: Camera,
        ground: GroundPlane,
    ) -> Float[np.ndarray, "h w"]:
        known = sparse_depth_m > 0
        source = trusted_sources(known)
        ground_m = plane_depth(camera, ground)
        trusted = ground_m < self.ground_reach_m
        prior = np.where(trusted, 1 / np.maximum(ground_m, 0.1), 1 / self.max_depth_m).astype(np.float32)
        weight = np.where(trusted, self.ground_pull, 1e-6).astype(np.float32)
        inverse = np.where(known, 1 / np.maximum(sparse_depth_m, 0.1), 0).astype(np.float32)
        filled = smooth_fill(inverse, source, sky & ~known, rgb.astype(np.float32) / 255, prior, weight)
        depth_m = 1 / np.clip(filled, 1 / self.max_depth_m, 10.0)
        bounded = np.where(trusted & ~known, np.minimum(depth_m, ground_m), depth_m)
        return np.asarray(bounded, dtype=np.float32)


def trusted_sources(known: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Known pixels that holes are filled from: without the rim of solid regions.

    Fused surfaces stick out over their edges by about a voxel, so their rim is painted with what is behind. Filling
    from there would pull the background to the edge's depth. Thin parts, which have no inside, stay.
    """
    side = 2 * max(1, round(known.shape[1] * _RIM_SHARE)) + 1
    window = np.ones((side, side), dtype=np.uint8)
    # beyond the image a region goes on
    inside = cv2.erode(known.astype(np.uint8), window, borderType=cv2.BORDER_CONSTANT, borderValue=1)
    near_inside = cv2.dilate(inside, window) > 0
    return np.asarray(known & ((inside > 0) | ~near_inside))
