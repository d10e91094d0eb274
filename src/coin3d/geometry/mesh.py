"""Triangle meshes without colour."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int32
from numpy.typing import ArrayLike

from coin3d.geometry.pose import Pose


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Triangles in whichever frame the variable's name says.

    Args:
        vertices_m: (n, 3) metres.
        faces: (m, 3) rows of ``vertices_m``, counter-clockwise seen from outside (from free space).

    Raises:
        ValueError: a vertex that is not finite, or a face that names a missing vertex or one vertex twice.
    """

    vertices_m: Float32[np.ndarray, "n 3"]
    faces: Int32[np.ndarray, "m 3"]

    def __post_init__(self) -> None:
        for name, rows in (("vertices_m", self.vertices_m), ("faces", self.faces)):
            if rows.ndim != 2 or rows.shape[1] != 3:
                raise ValueError(f"a mesh has {name} in rows of three, got the shape {rows.shape}")
        bad = ~np.isfinite(self.vertices_m).all(1)
        if bad.any():
            raise ValueError(
                f"vertex {int(np.argmax(bad))} of a mesh is not finite: {self.vertices_m[np.argmax(bad)].tolist()}"
            )
        missing = ((self.faces < 0) | (self.faces >= len(self.vertices_m))).any(1)
        if missing.any():
            row = int(np.argmax(missing))
            raise ValueError(f"face {row} names the vertices {self.faces[row].tolist()} of a mesh with {len(self.vertices_m)}")
        a, b, c = self.faces.T
        flat = (a == b) | (b == c) | (a == c)
        if flat.any():
            row = int(np.argmax(flat))
            raise ValueError(f"face {row} names a vertex twice: {self.faces[row].tolist()}")

    @classmethod
    def create(cls, vertices_m: ArrayLike, faces: ArrayLike) -> TriangleMesh:
        """From anything array-like."""
        return cls(
            np.ascontiguousarray(vertices_m, dtype=np.float32).reshape(-1, 3),
            np.ascontiguousarray(faces, dtype=np.int32).reshape(-1, 3),
        )

    @classmethod
    def empty(cls) -> TriangleMesh:
        return cls.create([], [])

    @classmethod
    def concatenate(cls, meshes: Iterable[TriangleMesh]) -> TriangleMesh:
        """The triangles of all meshes, in order; vertices are not merged."""
        parts = list(meshes)
        if not parts:
            return cls.empty()
        starts = np.cumsum([0] + [len(m.vertices_m) for m in parts[:-1]])
        return cls.create(
            np.concatenate([m.vertices_m for m in parts]),
            np.concatenate([m.faces + start for m, start in zip(parts, starts, strict=True)]),
        )

    def transformed(self, target_from_source: Pose) -> TriangleMesh:
        """The mesh in another frame."""
        return TriangleMesh.create(target_from_source.apply(self.vertices_m), self.faces)

    def corners_m(self) -> Float[np.ndarray, "m 3 3"]:
        """(m, 3, 3) the corners of every face in float64."""
        return np.asarray(self.vertices_m[self.faces], dtype=np.float64)

    @property
    def volume_m3(self) -> float:
        """Enclosed volume; only a watertight mesh has one. Negative if the faces are inside out."""
        if not len(self.faces):
            return 0.0
        # about the middle: far from the origin the sum of large signed volumes would lose digits
        a, b, c = np.moveaxis(self.corners_m() - self.vertices_m.mean(0, dtype=np.float64), 1, 0)
        return float((a * np.cross(b, c)).sum() / 6)

    @property
    def is_watertight(self) -> bool:
        """Whether every edge joins exactly two faces, which turn the same way; a mesh without faces is not."""
        if not len(self.faces):
            return False
        directed = self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
        there = np.unique(directed[:, 0] << 32 | directed[:, 1])
        back = np.unique(directed[:, 1] << 32 | directed[:, 0])
        return len(there) == len(directed) and np.array_equal(there, back)

    def without_loose_vertices(self) -> TriangleMesh:
        """The same faces, without vertices that no face uses."""
        used, faces = np.unique(self.faces, return_inverse=True)
        return TriangleMesh.create(self.vertices_m[used], faces.reshape(-1, 3))
