"""Points spread evenly over a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from coin3d.geometry.mesh import TriangleMesh


@dataclass(frozen=True, eq=False)
class SurfaceSamples:
    """Points on a surface in random order, so that every leading part covers all of it.

    Args:
        points_m: (n, 3).
        normals: (n, 3) unit, outward.
    """

    points_m: Float32[np.ndarray, "n 3"]
    normals: Float32[np.ndarray, "n 3"]


def sample_surface(mesh: TriangleMesh, spacing_m: float, most: int, seed: int) -> SurfaceSamples:
    """Area / spacing^2 points, at least 10 and at most ``most``, uniform over the surface, the same for the same seed."""
    corners = mesh.corners_m()
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1) / 2
    total = float(area.sum())
    if total <= 0:
        return SurfaceSamples(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32))
    count = int(np.clip(round(total / spacing_m**2), 10, most))
    rng = np.random.default_rng(seed)
    # stratified along the list of faces: more even than independent draws
    face = np.searchsorted(np.cumsum(area), (np.arange(count) + rng.random(count)) * total / count)
    face = np.minimum(face, len(area) - 1)
    a, b = rng.random((2, count))
    fold = a + b > 1
    a[fold], b[fold] = 1 - a[fold], 1 - b[fold]
    edge_1, edge_2 = corners[face, 1] - corners[face, 0], corners[face, 2] - corners[face, 0]
    points = corners[face, 0] + a[:, None] * edge_1 + b[:, None] * edge_2
    normals = cross[face] / (2 * area[face, None])
    order = rng.permutation(count)
    return SurfaceSamples(points[order].astype(np.float32), normals[order].astype(np.float32))
