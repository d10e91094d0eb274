"""Coloured triangle meshes and the few shapes everything in the town is built from."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cache

import numpy as np
from jaxtyping import Float, Int, UInt8
from numpy.typing import ArrayLike


class Material(IntEnum):
    """How a triangle answers to light."""

    MATT = 0
    GROUND = 1
    WALL = 2
    FOLIAGE = 3
    PAINT = 4
    GLASS = 5
    LAMP = 6


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles with one material and colour each.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3) rows of ``vertices``, counter-clockwise seen from outside.
        colour: (F, 3) linear reflectance in [0, 1].
        material: (F,) values of ``Material``.
        wall: (F,) row in the world's table of walls for ``Material.WALL``, else -1.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    colour: Float[np.ndarray, "f 3"]
    material: UInt8[np.ndarray, "f"]
    wall: Int[np.ndarray, "f"]

    @classmethod
    def create(
        cls, vertices: ArrayLike, faces: ArrayLike, colour: ArrayLike, material: Material = Material.MATT, wall: int = -1
    ) -> Mesh:
        """A mesh of one colour and material."""
        f = np.asarray(faces, dtype=np.int32).reshape(-1, 3)
        return cls(
            np.asarray(vertices, dtype=np.float32).reshape(-1, 3),
            f,
            np.broadcast_to(np.asarray(colour, dtype=np.float32), (len(f), 3)),
            np.full(len(f), int(material), dtype=np.uint8),
            np.full(len(f), wall, dtype=np.int32),
        )

    @classmethod
    def merge(cls, meshes: Iterable[Mesh]) -> Mesh:
        """One mesh holding the triangles of all, in order."""
        parts = list(meshes)
        if not parts:
            return cls.create(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(3))
        starts = np.cumsum([0] + [len(m.vertices) for m in parts[:-1]])
        return cls(
            np.concatenate([m.vertices for m in parts]),
            np.concatenate([m.faces + int(start) for m, start in zip(parts, starts, strict=True)]).astype(np.int32),
            np.concatenate([m.colour for m in parts]),
            np.concatenate([m.material for m in parts]),
            np.concatenate([m.wall for m in parts]),
        )

    def moved(self, offset_m: ArrayLike, yaw_rad: float = 0.0) -> Mesh:
        """Turned about +z, then shifted."""
        c, s = np.cos(yaw_rad), np.sin(yaw_rad)
        turned = self.vertices @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]], dtype=np.float32)
        return replace(self, vertices=(turned + np.asarray(offset_m, dtype=np.float32)).astype(np.float32))

    def fitted(self, size_m: ArrayLike) -> Mesh:
        """Stretched so that the bounds are exactly length x width x height, centred in x and y, standing on z = 0."""
        low, high = self.vertices.min(0), self.vertices.max(0)
        unit = (self.vertices - low) / (high - low) - np.array([0.5, 0.5, 0.0], dtype=np.float32)
        return replace(self, vertices=(unit * np.asarray(size_m, dtype=np.float32)).astype(np.float32))


def quad(corners: ArrayLike, colour: ArrayLike, material: Material = Material.MATT, wall: int = -1) -> Mesh:
    """Two triangles through four corners, counter-clockwise from outside."""
    return Mesh.create(corners, [[0, 1, 2], [0, 2, 3]], colour, material, wall)


def box(
    centre_m: ArrayLike,
    size_m: ArrayLike,
    colour: ArrayLike,
    material: Material = Material.MATT,
    taper: tuple[float, float] = (1.0, 1.0),
) -> Mesh:
    """An upright box; ``taper`` scales the top face in x and y."""
    half = np.asarray(size_m, dtype=np.float64) / 2
    ring = np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]]) * half[:2]
    bottom = np.column_stack([ring, np.full(4, -half[2])])
    top = np.column_stack([ring * taper, np.full(4, half[2])])
    return loft([bottom + centre_m, top + centre_m], colour, material)


def loft(rings: Sequence[ArrayLike], colour: ArrayLike, material: Material = Material.MATT, caps: bool = True) -> Mesh:
    """Skin over closed rings of equally many points; rings turn counter-clockwise seen from the last ring."""
    stack = np.asarray(rings, dtype=np.float64)
    count, n = stack.shape[:2]
    return Mesh.create(stack.reshape(-1, 3), _skin_faces(count, n, caps), colour, material)


@cache
def _skin_faces(rings: int, points: int, caps: bool) -> Int[np.ndarray, "f 3"]:
    faces = []
    for i in range(rings - 1):
        for j in range(points):
            a, b = i * points + j, i * points + (j + 1) % points
            faces += [[a, b, b + points], [a, b + points, a + points]]
    if caps:
        last = (rings - 1) * points
        for j in range(1, points - 1):
            faces += [[0, j + 1, j], [last, last + j, last + j + 1]]
    return np.array(faces, dtype=np.int32)


def cylinder(
    start_m: ArrayLike, end_m: ArrayLike, radius_m: float, colour: ArrayLike, sides: int = 8, end_radius_m: float | None = None
) -> Mesh:
    """A (tapered) rod from one point to another, closed at both ends."""
    start, end = np.asarray(start_m, dtype=np.float64), np.asarray(end_m, dtype=np.float64)
    axis = (end - start) / max(float(np.linalg.norm(end - start)), 1e-9)
    helper = np.array([0.0, 0.0, 1.0]) if abs(axis[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    u = _cross(axis, helper)
    u /= np.linalg.norm(u)
    v = _cross(axis, u)
    angle = 2 * np.pi * np.arange(sides) / sides
    circle = np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v
    return loft([start + radius_m * circle, end + (end_radius_m or radius_m) * circle], colour)


def _cross(a: Float[np.ndarray, "3"], b: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    # several times faster than np.cross on single vectors, and a town has tens of thousands of rods
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def ball(
    centre_m: ArrayLike,
    radius_m: ArrayLike,
    colour: ArrayLike,
    material: Material = Material.MATT,
    rings: int = 4,
    sides: int = 7,
    jitter: Float[np.ndarray, "k"] | None = None,
) -> Mesh:
    """An ellipsoid of stacked rings; ``jitter`` factors roughen the radius (crowns of trees)."""
    polar = np.linspace(-np.pi / 2, np.pi / 2, rings + 2)[1:-1]
    angle = 2 * np.pi * np.arange(sides) / sides
    unit = np.stack(
        [np.cos(polar)[:, None] * np.cos(angle), np.cos(polar)[:, None] * np.sin(angle), np.sin(polar)[:, None] + 0 * angle], -1
    ).reshape(-1, 3)
    unit = np.concatenate([unit, [[0, 0, -1], [0, 0, 1]]])
    if jitter is not None:
        unit = unit * jitter[: len(unit), None]
    faces = []
    for i in range(rings - 1):
        for j in range(sides):
            a, b = i * sides + j, i * sides + (j + 1) % sides
            faces += [[a, b, b + sides], [a, b + sides, a + sides]]
    south, north, last = rings * sides, rings * sides + 1, (rings - 1) * sides
    for j in range(sides):
        k = (j + 1) % sides
        faces += [[south, k, j], [north, last + j, last + k]]
    return Mesh.create(unit * np.asarray(radius_m) + np.asarray(centre_m), faces, colour, material)
