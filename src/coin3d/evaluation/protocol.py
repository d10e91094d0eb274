"""What a number means: classes, ranges, thresholds and filters, printed with every result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from coin3d.geometry import Boxes3D

DEFAULT_RANGE_M: Mapping[str, float] = {"car": 50.0, "pedestrian": 40.0, "two-wheel": 40.0}
"""Radial ranges of the nuScenes detection task for the three unified classes."""


@dataclass(frozen=True)
class Protocol:
    """The rules of one evaluation; the defaults are the nuScenes detection task on the three unified classes.

    Args:
        name: short name for tables.
        classes: class names that are scored; means are over these.
        range_m: class -> boxes count only if their centre is nearer to the ego origin than this.
        range_shape: ``radial``: sqrt(x^2 + y^2) below the range; ``square``: max(|x|, |y|) below it.
        distance_thresholds_m: a detection is right at a threshold if its centre is nearer than this (xy) to its object.
        tp_threshold_m: the one of them at which translation, scale and orientation errors are taken.
        min_recall: the part of the curve up to this recall does not count, in [0, 1).
        min_precision: precision is counted above this floor, in [0, 1).
        max_boxes_per_sample: only this many highest-scoring predictions of a sample are looked at.
        visible_only: keep truth and predictions only if their centre projects into at least one image.
        drop_zero_lidar: drop truth in which no LiDAR point was counted (unknown counts are kept).

    Raises:
        ValueError: rules that contradict each other, saying which.
    """

    name: str = "unified"
    classes: tuple[str, ...] = tuple(DEFAULT_RANGE_M)
    range_m: Mapping[str, float] = field(default_factory=lambda: dict(DEFAULT_RANGE_M))
    range_shape: Literal["radial", "square"] = "radial"
    distance_thresholds_m: tuple[float, ...] = (0.5, 1.0, 2.0, 4.0)
    tp_threshold_m: float = 2.0
    min_recall: float = 0.1
    min_precision: float = 0.1
    max_boxes_per_sample: int = 500
    visible_only: bool = True
    drop_zero_lidar: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "classes", tuple(self.classes))
        object.__setattr__(self, "distance_thresholds_m", tuple(float(t) for t in self.distance_thresholds_m))
        where = f"protocol '{self.name}'"
        if not self.classes or len(set(self.classes)) != len(self.classes):
            raise ValueError(f"{where}: classes are one or more different names, got {list(self.classes)}")
        if missing := [c for c in self.classes if c not in self.range_m]:
            raise ValueError(f"{where}: range_m has no range for {', '.join(missing)}")
        object.__setattr__(self, "range_m", {c: float(self.range_m[c]) for c in self.classes})
        if not all(r > 0 for r in self.range_m.values()):
            raise ValueError(f"{where}: ranges are positive metres, got {dict(self.range_m)}")
        if self.range_shape not in ("radial", "square"):
            raise ValueError(f"{where}: range_shape is 'radial' or 'square', got {self.range_shape!r}")
        thresholds = self.distance_thresholds_m
        if not thresholds or not all(t > 0 for t in thresholds) or len(set(thresholds)) != len(thresholds):
            raise ValueError(f"{where}: distance thresholds are different positive metres, got {list(thresholds)}")
        if self.tp_threshold_m not in thresholds:
            raise ValueError(f"{where}: tp_threshold_m = {self.tp_threshold_m:g} is not one of {list(thresholds)}")
        if not 0 <= self.min_recall < 1 or not 0 <= self.min_precision < 1:
            raise ValueError(
                f"{where}: min_recall and min_precision lie in [0, 1), got {self.min_recall:g}, {self.min_precision:g}"
            )
        if self.max_boxes_per_sample < 1:
            raise ValueError(f"{where}: max_boxes_per_sample is at least 1, got {self.max_boxes_per_sample}")

    @property
    def first_recall_index(self) -> int:
        """Index on the grid 0, 0.01 ... 1 of the first recall that counts: the one after ``min_recall``."""
        return round(100 * self.min_recall) + 1

    def in_range(self, boxes: Boxes3D) -> Bool[np.ndarray, "n"]:
        """Which boxes (ego frame) lie within the range of their class; boxes of other classes do not."""
        xy: Float[np.ndarray, "n 2"] = boxes.centre_m[:, :2]
        distance_m = np.hypot(xy[:, 0], xy[:, 1]) if self.range_shape == "radial" else np.abs(xy).max(axis=1)
        inside = np.zeros(len(boxes), dtype=bool)
        for name, limit_m in self.range_m.items():
            inside |= (boxes.labels == name) & (distance_m < limit_m)
        return inside

    def describe(self) -> str:
        """One line with every number, to be printed beside results."""
        shape = {"radial": "radial", "square": "square (|x|, |y|)"}[self.range_shape]
        ranges = ", ".join(f"{c} {r:g} m" for c, r in self.range_m.items())
        thresholds = "/".join(f"{t:g}" for t in self.distance_thresholds_m)
        return (
            f"{self.name}: {ranges}, {shape} range; AP at {thresholds} m, errors at {self.tp_threshold_m:g} m; "
            f"recall > {self.min_recall:g}, precision > {self.min_precision:g}; "
            f"at most {self.max_boxes_per_sample} boxes per sample; "
            f"{'only centres seen by a camera' if self.visible_only else 'seen by a camera or not'}; "
            f"{'objects without LiDAR points dropped' if self.drop_zero_lidar else 'objects without LiDAR points kept'}"
        )
