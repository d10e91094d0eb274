"""First hits of rays on a triangle mesh, by embree."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float, Int

from coin3d.geometry.mesh import TriangleMesh

# embree reports a miss as a huge finite distance
_MISS = 1e6
_STEP_M = 1e-3
# a ray passes at most so many faces that it meets from behind
_PASSES = 3


class RayCaster:
    """The acceleration structure of one mesh. Faces are met from their outside (counter-clockwise) only.

    Args:
        mesh: any size, also empty; its coordinates may be far from their origin (world frames are).

    Raises:
        ImportError: embreex is not installed.
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        vertices = np.asarray(mesh.vertices_m, dtype=np.float64)
        # float32 of a world frame kilometres away would cost millimetres
        self._anchor = vertices.mean(0) if len(vertices) else np.zeros(3)
        local = np.ascontiguousarray(vertices - self._anchor, dtype=np.float32)
        faces = np.ascontiguousarray(mesh.faces, dtype=np.int32)
        corners = local[faces]
        self._normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._scene: Any = None
        if len(faces):
            try:
                from embreex.mesh_construction import TriangleMesh as EmbreeMesh
                from embreex.rtcore_scene import EmbreeScene
            except ImportError as error:
                raise ImportError("scenes are ray-cast with embreex (x86-64): pip install 'coin3d[town]'") from error
            self._scene = EmbreeScene(robust=True)
            self._geometry = EmbreeMesh(self._scene, local, faces)

    def first_hits(
        self, origins: Float[np.ndarray, "#n 3"], rays: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n"], Int[np.ndarray, "n"]]:
        """First hits of rays.

        Args:
            origins: where the rays start, in the frame of the mesh; one row serves all rays.
            rays: directions of any length.

        Returns:
            Distance in units of the ray's length (infinite for a miss) and the face hit (-1 for a miss).
        """
        distance = np.full(len(rays), np.inf, dtype=np.float32)
        face = np.full(len(rays), -1, dtype=np.int32)
        if self._scene is None or not len(rays):
            return distance, face
        directions = np.ascontiguousarray(rays, dtype=np.float32)
        starts = np.broadcast_to((origins - self._anchor).astype(np.float32), directions.shape).copy()
        travelled = np.zeros(len(rays), dtype=np.float32)
        open_rows = np.arange(len(rays))
        for _ in range(_PASSES):
            found = self._scene.run(starts, directions[open_rows], query="INTERSECT", output=1)
            near, hit = found["tfar"], found["primID"]
            hits = (hit >= 0) & (near < _MISS)
            open_rows, near, hit, starts = open_rows[hits], near[hits], hit[hits], starts[hits]
            outside = np.einsum("ij,ij->i", self._normal[hit], directions[open_rows]) < 0
            done = open_rows[outside]
            distance[done] = travelled[done] + near[outside]
            face[done] = hit[outside]
            open_rows, near, starts = open_rows[~outside], near[~outside], starts[~outside]
            if not len(open_rows):
                break
            step = near + _STEP_M / np.linalg.norm(directions[open_rows], axis=1)
            travelled[open_rows] += step
            starts = np.ascontiguousarray(starts + step[:, None] * directions[open_rows])
        return distance, face
