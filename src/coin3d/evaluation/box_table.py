"""Boxes of many samples in columns: what is scored, without an object per frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from coin3d.geometry import Boxes3D

_MAX_CLASSES = 2**15 - 1


@dataclass(frozen=True, eq=False)
class BoxTable:
    """N boxes of S samples, one sample after another; every column is an array with N rows.

    All boxes of a sample are in one frame with z up; which one, the variable's name says.

    Args:
        tokens: (S,) names of the samples, each once.
        start: (S + 1,) the boxes of sample s are the rows ``start[s]`` .. ``start[s + 1] - 1``.
        classes: names of the classes.
        label: (N,) place in ``classes``; -1 for a box that takes no part.
        centre_m: (N, 3) centre of gravity.
        size_m: (N, 3) length (along the heading), width, height.
        yaw_rad: (N,) heading about +z from +x.
        score: (N,) confidence in [0, 1]; ones for ground truth.
        num_lidar_points: (N,) points inside as annotated, -1 where unknown; None where nobody counted.
        visibility: (N,) levels as annotated (``Boxes3D.visibility``), 0 where unknown; None where nobody judged.

    Raises:
        ValueError: columns that do not match, a number that is not finite, or a size that is not positive; the message
            names the sample.
    """

    tokens: tuple[str, ...]
    start: Int[np.ndarray, "s1"]
    classes: tuple[str, ...]
    label: Int[np.ndarray, "n"]
    centre_m: Float[np.ndarray, "n 3"]
    size_m: Float[np.ndarray, "n 3"]
    yaw_rad: Float[np.ndarray, "n"]
    score: Float[np.ndarray, "n"]
    num_lidar_points: Int[np.ndarray, "n"] | None = None
    visibility: Int[np.ndarray, "n"] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "tokens", tuple(self.tokens))
        object.__setattr__(self, "classes", tuple(self.classes))
        object.__setattr__(self, "start", np.ascontiguousarray(self.start, dtype=np.int64))
        object.__setattr__(self, "label", np.ascontiguousarray(self.label, dtype=np.int16))
        for name in ("centre_m", "size_m", "yaw_rad", "score"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=np.float64))
        n, start = len(self.label), self.start
        if len(start) != len(self.tokens) + 1 or start[0] != 0 or start[-1] != n or (np.diff(start) < 0).any():
            raise ValueError(f"a table of {n} boxes of {len(self.tokens)} samples has group borders that do not fit")
        if len(set(self.tokens)) != len(self.tokens):
            raise ValueError("a table names a sample twice")
        if len(set(self.classes)) != len(self.classes) or len(self.classes) > _MAX_CLASSES:
            raise ValueError(f"classes are at most {_MAX_CLASSES} different names, got {list(self.classes)[:8]}")
        if n and (self.label.min() < -1 or self.label.max() >= len(self.classes)):
            raise ValueError(f"labels are -1 .. {len(self.classes) - 1}, got {self.label.min()} .. {self.label.max()}")
        for name, width in (("centre_m", 3), ("size_m", 3), ("yaw_rad", 0), ("score", 0)):
            column = getattr(self, name)
            if column.shape != ((n, width) if width else (n,)):
                raise ValueError(f"a table of {n} boxes has {name} of shape {column.shape}")
            # a sum is finite only if all are, up to overflow, which the exact look then clears; it needs no memory
            if not np.isfinite(column.sum()) and not (good := np.isfinite(column)).all():
                row = int(np.argmin(good.reshape(n, -1).all(1)))
                raise ValueError(f"sample '{self.token_of(row)}' has a box with a {name} that is not finite")
        if n and self.size_m.min() <= 0:
            row = int(self.size_m.argmin()) // 3
            raise ValueError(
                f"sample '{self.token_of(row)}' has a box of size {self.size_m[row].tolist()}: "
                "length, width, height are positive metres"
            )
        for name in ("num_lidar_points", "visibility"):
            known = getattr(self, name)
            if known is not None and known.shape != (n,):
                raise ValueError(f"a table of {n} boxes has {len(known)} rows of {name}")

    @classmethod
    def from_boxes(cls, boxes: Mapping[str, Boxes3D], classes: tuple[str, ...]) -> BoxTable:
        """All rows in the order of the mapping; boxes of classes that are not named take no part."""
        start = np.concatenate([[0], np.cumsum([len(b) for b in boxes.values()], dtype=np.int64)])
        stacked = Boxes3D.concatenate(boxes.values())
        label = np.full(len(stacked), -1, dtype=np.int16)
        for i, name in enumerate(classes):
            label[stacked.labels == name] = i
        return cls(
            tuple(boxes),
            start,
            tuple(classes),
            label,
            stacked.centre_m,
            stacked.size_m,
            stacked.yaw_rad,
            stacked.scores,
            stacked.num_lidar_points,
            stacked.visibility.astype(np.int8),
        )

    def __len__(self) -> int:
        return len(self.label)

    @cached_property
    def place_of(self) -> dict[str, int]:
        """Token -> place of the sample."""
        return {token: s for s, token in enumerate(self.tokens)}

    def token_of(self, row: int) -> str:
        """The sample that a row belongs to."""
        return self.tokens[int(np.searchsorted(self.start, row, side="right")) - 1]

    def sample_of_rows(self) -> Int[np.ndarray, "n"]:
        """Place of the sample of every row (int32)."""
        return np.repeat(np.arange(len(self.tokens), dtype=np.int32), np.diff(self.start))

    def boxes_of(self, token: str) -> Boxes3D:
        """The boxes of a sample that take part; none for a sample that is not in the table."""
        if token not in self.place_of:
            return Boxes3D.empty()
        first, last = self.start[self.place_of[token]], self.start[self.place_of[token] + 1]
        rows = first + np.flatnonzero(self.label[first:last] >= 0)
        return Boxes3D.create(
            self.centre_m[rows],
            self.size_m[rows],
            self.yaw_rad[rows],
            [self.classes[label] for label in self.label[rows]],
            scores=self.score[rows],
            num_lidar_points=None if self.num_lidar_points is None else self.num_lidar_points[rows],
            visibility=None if self.visibility is None else self.visibility[rows],
        )

    def only(self, counts: Bool[np.ndarray, "n"]) -> BoxTable:
        """The same rows, of which those that do not count take no part. Other columns are shared, not copied."""
        return replace(self, label=np.where(counts, self.label, np.int16(-1)))

    def number_of(self, class_name: str) -> int:
        """How many boxes of a class take part."""
        return int(np.count_nonzero(self.label == self.classes.index(class_name)))
