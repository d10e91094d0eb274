"""Nearest hits and shadows by embree: one structure for what stands, a second small one for what moves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from coin3d.town.mesh import Mesh
from coin3d.town.world import World

# embree reports a miss as a huge finite distance
_MISS_M = 1e6


class _Structure:
    """An embree scene of one mesh."""

    def __init__(self, mesh: Mesh) -> None:
        try:
            from embreex.mesh_construction import TriangleMesh
            from embreex.rtcore_scene import EmbreeScene
        except ImportError as error:
            raise ImportError("the town is ray-cast with embreex (x86-64): pip install 'coin3d[town]'") from error

        self._scene: Any = EmbreeScene(robust=True)
        self._geometry = TriangleMesh(
            self._scene, np.ascontiguousarray(mesh.vertices, dtype=np.float32), np.ascontiguousarray(mesh.faces, dtype=np.int32)
        )

    def nearest(
        self, origins: Float[np.ndarray, "n 3"], rays: Float[np.ndarray, "n 3"], limit: Float[np.ndarray, "n"]
    ) -> tuple[Float[np.ndarray, "n"], Int[np.ndarray, "n"]]:
        found = self._scene.run(origins, rays, limit, query="INTERSECT", output=1)
        return found["tfar"], found["primID"]

    def blocked(self, origins: Float[np.ndarray, "n 3"], rays: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
        return np.asarray(np.asarray(self._scene.run(origins, rays, query="OCCLUDED")) == 0)


@dataclass(frozen=True, eq=False)
class Hits:
    """Where rays end: distance in units of the ray's length (infinite for the sky) and the face hit (-1 for the sky)."""

    distance: Float[np.ndarray, "n"]
    face: Int[np.ndarray, "n"]


class Moment:
    """The town at one time, ready for rays. Faces are numbered: static ones first, then moving ones."""

    def __init__(self, world: World, static: _Structure, static_normals: Float[np.ndarray, "f 3"], time_s: float) -> None:
        self.world = world
        self.time_s = time_s
        self._static = static
        moving, moving_actor = world.moving_mesh(time_s)
        self._moving = _Structure(moving) if len(moving.faces) else None
        self._first_moving = len(world.static.faces)
        self.colour = np.concatenate([world.static.colour, moving.colour]).astype(np.float32)
        self.material = np.concatenate([world.static.material, moving.material])
        self.wall = np.concatenate([world.static.wall, moving.wall])
        self.actor = np.concatenate([world.static_actor, moving_actor])
        self.normal = np.concatenate([static_normals, face_normals(moving)])

    def cast(self, origins: Float[np.ndarray, "n 3"], rays: Float[np.ndarray, "n 3"]) -> Hits:
        """First hits of rays given in world coordinates."""
        origins, rays = np.ascontiguousarray(origins, dtype=np.float32), np.ascontiguousarray(rays, dtype=np.float32)
        limit = np.full(len(rays), 1e37, dtype=np.float32)
        distance, face = self._static.nearest(origins, rays, limit)
        if self._moving is not None:
            near, other = self._moving.nearest(origins, rays, np.ascontiguousarray(distance))
            hit = other >= 0
            distance = np.where(hit, near, distance)
            face = np.where(hit, other + self._first_moving, face)
        miss = (face < 0) | (distance > _MISS_M)
        return Hits(np.where(miss, np.float32(np.inf), distance), np.where(miss, -1, face))

    def in_shadow(self, points: Float[np.ndarray, "n 3"], direction: Float[np.ndarray, "3"]) -> Bool[np.ndarray, "n"]:
        """Whether anything lies between points and a far light."""
        points = np.ascontiguousarray(points, dtype=np.float32)
        rays = np.ascontiguousarray(np.broadcast_to(direction.astype(np.float32), points.shape))
        dark = self._static.blocked(points, rays)
        if self._moving is not None:
            dark |= self._moving.blocked(points, rays)
        return dark


class Tracer:
    """Holds the acceleration structure of a world's static geometry."""

    def __init__(self, world: World) -> None:
        self.world = world
        self._static = _Structure(world.static)
        self._normals = face_normals(world.static)

    def at(self, time_s: float) -> Moment:
        """The town at one time."""
        return Moment(self.world, self._static, self._normals, time_s)


def face_normals(mesh: Mesh) -> Float[np.ndarray, "f 3"]:
    """Unit normals of all faces."""
    corner = mesh.vertices[mesh.faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return np.asarray((normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)).astype(np.float32))
