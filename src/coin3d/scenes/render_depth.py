"""Depth of the fused surfaces as the cameras of a key frame see them (paper sec. 4.2; spec official_code 4, step 2.1)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from coin3d.datasets.frame import Frame
from coin3d.geometry import Camera, Pose
from coin3d.geometry.mesh import TriangleMesh
from coin3d.scenes.ray_cast import RayCaster
from coin3d.scenes.tracks import instance_names
from coin3d.scenes.views import pixel_rays_ego

MAX_MESH_DEPTH_M = 100.0
BACKGROUND = -1


@dataclass(frozen=True, eq=False)
class MeshDepth:
    """What the meshes look like from one camera.

    Args:
        depth_m: (h, w) depth along the optical axis of whatever is nearest, 0 where no mesh is hit.
        background_m: the same of the background alone: what stands behind the objects.
        box: (h, w) row of the key frame's boxes whose object is seen, ``BACKGROUND`` (-1) elsewhere.
    """

    depth_m: Float[np.ndarray, "h w"]
    background_m: Float[np.ndarray, "h w"]
    box: Int[np.ndarray, "h w"]


class FrameSurfaces:
    """Background and posed objects of one key frame, ready for rays.

    Args:
        background: structure of the background mesh in the world frame, shared by all frames of a scene.
        objects: instance name -> mesh in the frame of its box (origin at the box centre, x along the heading).
        frame: whose boxes say where the objects are.
    """

    def __init__(self, background: RayCaster, objects: Mapping[str, TriangleMesh], frame: Frame) -> None:
        self._background = background
        self._world_from_ego = frame.world_from_ego
        posed, self._box_of_face = posed_objects(objects, frame)
        self._objects = RayCaster(posed)

    def render(self, camera: Camera) -> MeshDepth:
        """Depth through the centres of all pixels; the camera is given in the ego frame of this key frame."""
        rays_ego = pixel_rays_ego(camera).reshape(-1, 3)
        centre_ego = camera.ego_from_cam.translation[None]
        behind, _ = self._background.first_hits(self._world_from_ego.apply(centre_ego), self._world_from_ego.rotate(rays_ego))
        front, face = self._objects.first_hits(centre_ego, rays_ego)
        is_object = (face >= 0) & (front <= behind) & (front < MAX_MESH_DEPTH_M)
        box = np.full(len(rays_ego), BACKGROUND, dtype=np.int32)
        box[is_object] = self._box_of_face[face[is_object]]
        background = np.where(behind < MAX_MESH_DEPTH_M, behind, np.float32(0))
        nearest = np.where(is_object, front, background)
        shape = (camera.height_px, camera.width_px)
        return MeshDepth(nearest.reshape(shape), background.reshape(shape), box.reshape(shape))

    def drop_m(self, points_ego: Float[np.ndarray, "n 3"], down_ego: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n"]:
        """How far points fall along ``down_ego`` until they meet the background; infinite where there is none."""
        rays = np.broadcast_to(self._world_from_ego.rotate(down_ego), points_ego.shape)
        return self._background.first_hits(self._world_from_ego.apply(points_ego), rays)[0]


def posed_objects(objects: Mapping[str, TriangleMesh], frame: Frame) -> tuple[TriangleMesh, Int[np.ndarray, "f"]]:
    """All objects at the places of their boxes as one mesh in the ego frame, and the row of the box each face belongs to."""
    posed: list[TriangleMesh] = []
    rows = [np.zeros(0, dtype=np.int32)]
    for row, name in enumerate(instance_names(frame)):
        if name in objects:
            posed.append(objects[name].transformed(ego_from_box(frame, row)))
            rows.append(np.full(len(objects[name].faces), row, dtype=np.int32))
    return TriangleMesh.concatenate(posed), np.concatenate(rows)


def ego_from_box(frame: Frame, row: int) -> Pose:
    """Pose of one box of a frame: origin at its centre, x along its heading, upright in the world."""
    boxes = frame.boxes_world
    if boxes is None:
        raise ValueError(f"frame {frame.token} has no boxes")
    world_from_box = Pose.from_euler(float(boxes.yaw_rad[row]), 0.0, 0.0, boxes.centre_m[row])
    return frame.world_from_ego.inverse() @ world_from_box
