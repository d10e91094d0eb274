"""A table of 3D boxes: ground truth or predictions, in whichever frame the variable's name says."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from numpy.typing import ArrayLike

from coin3d.geometry.pose import Pose

# signs of (length, width, height) at the eight corners: bottom four counter-clockwise from front left, then the top four
_CORNER_SIGNS = np.array(
    [[1, 1, -1], [-1, 1, -1], [-1, -1, -1], [1, -1, -1], [1, 1, 1], [-1, 1, 1], [-1, -1, 1], [1, -1, 1]], dtype=np.float64
)


VISIBILITY_PERCENT = (0, 40, 60, 80, 100)
"""Visibility level k stands for a visible share from entry k - 1 to entry k (the levels of nuScenes)."""


def wrap_angle(angle_rad: ArrayLike) -> Float[np.ndarray, "..."]:
    """Angle in (-pi, pi]."""
    a = np.asarray(angle_rad, dtype=np.float64)
    return np.asarray(-((np.pi - a) % (2 * np.pi) - np.pi))


@dataclass(frozen=True, eq=False)
class Boxes3D:
    """N upright boxes; every field is an array with N rows.

    Args:
        centre_m: (N, 3) centre of gravity.
        size_m: (N, 3) length (along the heading), width, height.
        yaw_rad: (N,) heading about +z from +x.
        labels: (N,) class names.
        scores: (N,) confidence in [0, 1]; ones for ground truth.
        velocity_mps: (N, 2) in the xy plane; NaN where unknown.
        instance_ids: (N,) names that persist through a sequence; "" where unknown.
        num_lidar_points: (N,) points inside as annotated; -1 where unknown.
        visibility: (N,) how much of the object the cameras of its recording saw, as annotated: levels 1 to 4 of
            ``VISIBILITY_PERCENT``; 0 where unknown.

    Raises:
        ValueError: rows that do not match, a number that is not finite, a size that is not positive, or a visibility that
            is no level.
    """

    centre_m: Float[np.ndarray, "n 3"]
    size_m: Float[np.ndarray, "n 3"]
    yaw_rad: Float[np.ndarray, "n"]
    labels: Shaped[np.ndarray, "n"]
    scores: Float[np.ndarray, "n"]
    velocity_mps: Float[np.ndarray, "n 2"]
    instance_ids: Shaped[np.ndarray, "n"]
    num_lidar_points: Int[np.ndarray, "n"]
    visibility: Int[np.ndarray, "n"]

    @classmethod
    def create(
        cls,
        centre_m: ArrayLike,
        size_m: ArrayLike,
        yaw_rad: ArrayLike,
        labels: Sequence[str] | Shaped[np.ndarray, "n"],
        *,
        scores: ArrayLike | None = None,
        velocity_mps: ArrayLike | None = None,
        instance_ids: Sequence[str] | Shaped[np.ndarray, "n"] | None = None,
        num_lidar_points: ArrayLike | None = None,
        visibility: ArrayLike | None = None,
    ) -> Boxes3D:
        """Build a table from whatever is known; the rest is filled with the documented 'unknown'."""
        centre = np.asarray(centre_m, dtype=np.float64).reshape(-1, 3)
        n = len(centre)
        return cls(
            centre,
            np.asarray(size_m, dtype=np.float64).reshape(-1, 3),
            wrap_angle(np.asarray(yaw_rad, dtype=np.float64).reshape(-1)),
            np.asarray(labels, dtype=np.str_).reshape(-1),
            np.ones(n) if scores is None else np.asarray(scores, dtype=np.float64).reshape(-1),
            np.full((n, 2), np.nan) if velocity_mps is None else np.asarray(velocity_mps, dtype=np.float64).reshape(-1, 2),
            np.full(n, "", dtype=np.str_) if instance_ids is None else np.asarray(instance_ids, dtype=np.str_).reshape(-1),
            np.full(n, -1, dtype=np.int64)
            if num_lidar_points is None
            else np.asarray(num_lidar_points, dtype=np.int64).reshape(-1),
            np.zeros(n, dtype=np.int64) if visibility is None else np.asarray(visibility, dtype=np.int64).reshape(-1),
        )

    @classmethod
    def empty(cls) -> Boxes3D:
        return cls.create(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), [])

    @classmethod
    def concatenate(cls, tables: Iterable[Boxes3D]) -> Boxes3D:
        """All rows of several tables, in order."""
        tables = list(tables)
        if not tables:
            return cls.empty()
        return cls(*(np.concatenate([getattr(t, f.name) for t in tables]) for f in fields(cls)))

    def __post_init__(self) -> None:
        n = len(self.centre_m)
        for f in fields(self):
            rows = len(getattr(self, f.name))
            if rows != n:
                raise ValueError(f"a table of {n} boxes has {rows} rows of {f.name}")
        for name in ("centre_m", "size_m", "yaw_rad", "scores"):
            bad = ~np.isfinite(getattr(self, name)).reshape(n, -1).all(1) if n else np.zeros(0, dtype=bool)
            if bad.any():
                raise ValueError(f"box {int(np.argmax(bad))} has a {name} that is not finite")
        if n and (self.size_m <= 0).any():
            row = int(np.argmax((self.size_m <= 0).any(1)))
            raise ValueError(f"box {row} has the size {self.size_m[row].tolist()}: length, width, height are positive metres")
        levels = len(VISIBILITY_PERCENT) - 1
        if n and not 0 <= self.visibility.min() <= self.visibility.max() <= levels:
            row = int(np.argmax((self.visibility < 0) | (self.visibility > levels)))
            raise ValueError(
                f"box {row} has the visibility {self.visibility[row]}: levels are 1 to {levels}, and 0 where it is unknown"
            )

    def __len__(self) -> int:
        return len(self.centre_m)

    def __getitem__(self, rows: slice | Bool[np.ndarray, "n"] | Int[np.ndarray, "m"]) -> Boxes3D:
        """A table of some rows, by mask, index array or slice."""
        return Boxes3D(*(getattr(self, f.name)[rows] for f in fields(self)))

    def with_labels(self, labels: Sequence[str] | Shaped[np.ndarray, "n"]) -> Boxes3D:
        """The same boxes with other class names."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return Boxes3D(**{**values, "labels": np.asarray(labels, dtype=np.str_)})

    def transformed(self, target_from_source: Pose) -> Boxes3D:
        """The boxes in another frame. They stay upright: of the rotation's tilt only the effect on heading is kept."""
        c, s = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        heading = target_from_source.rotate(np.stack([c, s, np.zeros_like(c)], axis=-1))
        flat_velocity = np.concatenate([self.velocity_mps, np.zeros((len(self), 1))], axis=1)
        values: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self)}
        values["centre_m"] = target_from_source.apply(self.centre_m)
        values["yaw_rad"] = np.arctan2(heading[:, 1], heading[:, 0])
        values["velocity_mps"] = target_from_source.rotate(flat_velocity)[:, :2]
        return Boxes3D(**values)

    def corners(self) -> Float[np.ndarray, "n 8 3"]:
        """Corners: 0-3 bottom (front left, rear left, rear right, front right), 4-7 the same on top."""
        local = _CORNER_SIGNS[None] * self.size_m[:, None] / 2
        c, s = np.cos(self.yaw_rad)[:, None], np.sin(self.yaw_rad)[:, None]
        x = c * local[..., 0] - s * local[..., 1]
        y = s * local[..., 0] + c * local[..., 1]
        corners: np.ndarray = np.stack([x, y, local[..., 2]], axis=-1) + self.centre_m[:, None]
        return corners

    def contains(self, points: Float[np.ndarray, "m 3"]) -> Bool[np.ndarray, "n m"]:
        """Which points lie inside which box (faces included); points are in the frame of the boxes."""
        offset = np.asarray(points, dtype=np.float64)[None] - self.centre_m[:, None]
        c, s = np.cos(self.yaw_rad)[:, None], np.sin(self.yaw_rad)[:, None]
        half = self.size_m[:, None] / 2
        along = c * offset[..., 0] + s * offset[..., 1]
        across = -s * offset[..., 0] + c * offset[..., 1]
        inside = (np.abs(along) <= half[..., 0]) & (np.abs(across) <= half[..., 1])
        return np.asarray(inside & (np.abs(offset[..., 2]) <= half[..., 2]))

    def count_points(self, points: Float[np.ndarray, "m 3"]) -> Int[np.ndarray, "n"]:
        """Number of points inside each box, one box at a time so that memory stays that of the cloud."""
        counts = [int(self[i : i + 1].contains(points).sum()) for i in range(len(self))]
        return np.asarray(counts, dtype=np.int64)
