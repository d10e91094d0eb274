"""What one camera of a key frame sees, with a depth for every pixel (paper sec. 4.2; spec official_code 4, steps 2.1-2.2)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from coin3d.datasets.frame import Frame
from coin3d.geometry import Camera, GroundPlane
from coin3d.scenes.completion import DepthCompletion
from coin3d.scenes.lidar_depth import lidar_depth
from coin3d.scenes.render_depth import BACKGROUND, FrameSurfaces
from coin3d.scenes.silhouettes import trim_silhouettes
from coin3d.scenes.sky import SKY_DEPTH_M, find_sky
from coin3d.scenes.steep_pixels import snap_steep
from coin3d.scenes.views import View, load_views

FROM_COMPLETION, FROM_MESH, FROM_LIDAR, FROM_SKY, OF_OWN_VEHICLE = 0, 1, 2, 3, 4
"""Where a pixel's depth comes from."""

OWN_VEHICLE = -2
"""In place of the row of a box: pixels of the vehicle itself, which is no part of the scene. Its depth only says: near."""

_OWN_VEHICLE_M = 0.3

_RIM_SHARE = 0.1
_MIN_RIM_PX = 2
_AGREES_M = 0.3
_PEEP_SHARE = 1 / 200
OVERHANG_M = 0.15
"""How far fused surfaces stick out over true edges: a voxel and a half."""


@dataclass(frozen=True, eq=False)
class SeenView:
    """An image with depth.

    Args:
        name: of the camera in its rig.
        camera: at building size, in the ego frame of the key frame.
        rgb: (h, w, 3).
        depth_m: (h, w) positive depth along the optical axis.
        source: (h, w) which of ``FROM_MESH`` and its like the depth is.
        box: (h, w) row of the frame's boxes whose object is seen, -1 for the background, ``OWN_VEHICLE``.
        behind_m: (h, w) depth of the background mesh alone, 0 where it has none.
    """

    name: str
    camera: Camera
    rgb: UInt8[np.ndarray, "h w 3"]
    depth_m: Float[np.ndarray, "h w"]
    source: UInt8[np.ndarray, "h w"]
    box: Int[np.ndarray, "h w"]
    behind_m: Float[np.ndarray, "h w"]

    @cached_property
    def farthest_near_m(self) -> Float[np.ndarray, "h w"]:
        """The largest depth within two pixels, at 400 pixels width."""
        side = 2 * max(1, round(self.camera.width_px * _PEEP_SHARE)) + 1
        return np.asarray(cv2.dilate(self.depth_m, np.ones((side, side), dtype=np.uint8)))

    @cached_property
    def near_object(self) -> Bool[np.ndarray, "h w"]:
        """Objects with a rim around them, as wide as a tenth of the root of their area: meshes and masks are not exact."""
        mask = np.zeros(self.box.shape, dtype=bool)
        for row in np.unique(self.box[self.box != BACKGROUND]):
            inside = (self.box == row).astype(np.uint8)
            rim = max(_MIN_RIM_PX, round(_RIM_SHARE * float(np.sqrt(inside.sum()))))
            left, top, width, height = cv2.boundingRect(inside)
            rows = slice(max(0, top - rim), top + height + rim)
            columns = slice(max(0, left - rim), left + width + rim)
            around = cv2.dilate(inside[rows, columns], np.ones((2 * rim + 1, 2 * rim + 1), dtype=np.uint8))
            mask[rows, columns] |= around > 0
        return mask


def see_frame(
    frame: Frame, surfaces: FrameSurfaces, ground: GroundPlane, completion: DepthCompletion, width_px: int
) -> list[SeenView]:
    """All cameras of a key frame: mesh depth kept as it is, holes from the frame's own LiDAR, the sky, and completion."""
    points_ego = np.zeros((0, 3)) if frame.lidar is None else frame.lidar.load().points_ego
    return [_see(view, surfaces, points_ego, ground, completion) for view in load_views(frame, width_px)]


def _see(
    view: View, surfaces: FrameSurfaces, points_ego: Float[np.ndarray, "n 3"], ground: GroundPlane, completion: DepthCompletion
) -> SeenView:
    mesh = surfaces.render(view.camera)
    returns_m = lidar_depth(points_ego, view.camera)
    sparse_m = np.where(mesh.depth_m > 0, mesh.depth_m, returns_m).astype(np.float32)
    source = np.where(mesh.depth_m > 0, FROM_MESH, np.where(returns_m > 0, FROM_LIDAR, FROM_COMPLETION)).astype(np.uint8)
    sky = find_sky(view.rgb, sparse_m, view.camera, ground)
    source[sky] = FROM_SKY
    dense_m = np.asarray(completion(view.rgb, sparse_m, sky, view.camera, ground))
    unknown = source == FROM_COMPLETION
    if dense_m.shape != sparse_m.shape or not (np.isfinite(dense_m[unknown]).all() and (dense_m[unknown] > 0).all()):
        raise ValueError(
            f"{view.name}: depth completion returned {dense_m.shape} with depths that are not all positive and finite"
        )
    depth_m = np.where(sparse_m > 0, sparse_m, np.where(sky, np.float32(SKY_DEPTH_M), dense_m)).astype(np.float32)
    depth_m = snap_steep(depth_m, unknown)
    exact = (returns_m > 0) & (np.abs(returns_m - mesh.depth_m) < _AGREES_M)
    trimmed = trim_silhouettes(view.rgb, depth_m, source == FROM_MESH, exact, view.camera.focal_px, OVERHANG_M)
    source[trimmed.moved] = FROM_COMPLETION
    box = np.where(trimmed.moved, np.int32(BACKGROUND), mesh.box)
    source[view.own_vehicle] = OF_OWN_VEHICLE
    box = np.where(view.own_vehicle, np.int32(OWN_VEHICLE), box)
    depth_m = np.where(view.own_vehicle, np.float32(_OWN_VEHICLE_M), trimmed.depth_m)
    return SeenView(view.name, view.camera, view.rgb, depth_m, source, box, mesh.background_m)
