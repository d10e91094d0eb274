"""Points that know from where they were seen."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from coin3d.geometry import Pose

_MIRROR = np.array([1.0, -1.0, 1.0])


@dataclass(frozen=True, eq=False)
class RayCloud:
    """LiDAR returns and the sensor positions their rays started at, both in one frame.

    Args:
        points_m: (n, 3).
        origin_of: (n,) row of ``origins_m`` for every point. Sweeps are many points from few places.
        origins_m: (s, 3).

    Raises:
        ValueError: a point without origin.
    """

    points_m: Float[np.ndarray, "n 3"]
    origin_of: Int[np.ndarray, "n"]
    origins_m: Float[np.ndarray, "s 3"]

    def __post_init__(self) -> None:
        if len(self.origin_of) and not 0 <= self.origin_of.min() <= self.origin_of.max() < len(self.origins_m):
            raise ValueError(f"a ray names an origin outside the {len(self.origins_m)} that are given")

    @classmethod
    def from_origin(cls, points_m: Float[np.ndarray, "n 3"], origin_m: Float[np.ndarray, "3"]) -> RayCloud:
        """Points seen from one place."""
        points = np.asarray(points_m, dtype=np.float64).reshape(-1, 3)
        return cls(points, np.zeros(len(points), dtype=np.int32), np.asarray(origin_m, dtype=np.float64).reshape(1, 3))

    @classmethod
    def concatenate(cls, clouds: Iterable[RayCloud]) -> RayCloud:
        parts = list(clouds)
        if not parts:
            return cls(np.zeros((0, 3)), np.zeros(0, dtype=np.int32), np.zeros((0, 3)))
        starts = np.cumsum([0] + [len(p.origins_m) for p in parts[:-1]])
        return cls(
            np.concatenate([p.points_m for p in parts]),
            np.concatenate([p.origin_of + start for p, start in zip(parts, starts, strict=True)]).astype(np.int32),
            np.concatenate([p.origins_m for p in parts]),
        )

    def __len__(self) -> int:
        return len(self.points_m)

    def __getitem__(self, rows: slice | Bool[np.ndarray, "n"] | Int[np.ndarray, "m"]) -> RayCloud:
        """Some of the rays."""
        return RayCloud(self.points_m[rows], self.origin_of[rows], self.origins_m)

    def transformed(self, target_from_source: Pose) -> RayCloud:
        """The rays, points and origins alike, in another frame."""
        return RayCloud(target_from_source.apply(self.points_m), self.origin_of, target_from_source.apply(self.origins_m))

    def mirrored(self) -> RayCloud:
        """The rays at the plane y = 0: what a sensor on the other side of a symmetric body would have seen."""
        return RayCloud(self.points_m * _MIRROR, self.origin_of, self.origins_m * _MIRROR)

    def batches(self, size: int) -> Iterator[RayCloud]:
        """The rays in order, ``size`` at a time."""
        return (self[i : i + size] for i in range(0, len(self), size))

    def toward_origin(self) -> Float[np.ndarray, "n 3"]:
        """(n, 3) unit vectors from the points back to the sensor."""
        rays = self.origins_m[self.origin_of] - self.points_m
        unit: np.ndarray = rays / np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-12)
        return unit

    def range_m(self) -> Float[np.ndarray, "n"]:
        """Distance of every point from its sensor."""
        return np.asarray(np.linalg.norm(self.points_m - self.origins_m[self.origin_of], axis=1))
