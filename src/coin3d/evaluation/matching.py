"""Which object each detection takes, for all samples at once."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from coin3d.evaluation.box_table import BoxTable
from coin3d.evaluation.curves import RankedClass
from coin3d.evaluation.protocol import Protocol
from coin3d.geometry import wrap_angle
from coin3d.native import match_boxes

_THREADS = os.cpu_count() or 1


@dataclass(frozen=True, eq=False)
class Matches:
    """Detections matched to objects: everything that metrics, curves, breakdowns and intervals are made from.

    Args:
        truth: objects; those labelled -1 take no part.
        predictions: detections, with the same classes.
        protocol: classes and thresholds.
        object_row: (T, N) row of ``truth`` that each detection takes at each threshold, -1 for a false positive.
    """

    truth: BoxTable
    predictions: BoxTable
    protocol: Protocol
    object_row: Int[np.ndarray, "t n"]

    @cached_property
    def ranked_rows(self) -> tuple[Int[np.ndarray, "k"], ...]:
        """For every class of the protocol the rows of its detections, most confident first.

        Equal scores: the later row first, which is the order of the nuScenes devkit.
        """

        def ranked(c: int) -> Int[np.ndarray, "k"]:
            rows = np.flatnonzero(self.predictions.label == c)
            # reversing an ascending stable sort puts the later of equal scores first
            return np.asarray(rows[np.argsort(self.predictions.score[rows], kind="stable")[::-1]])

        with ThreadPoolExecutor(_THREADS) as pool:
            return tuple(pool.map(ranked, range(len(self.protocol.classes))))

    @cached_property
    def ranked_scores(self) -> tuple[Float[np.ndarray, "k"], ...]:
        """The scores of ``ranked_rows``."""
        return tuple(self.predictions.score[rows] for rows in self.ranked_rows)

    def ranked(self, class_name: str, threshold_m: float) -> RankedClass:
        """Hits and misses of a class at a threshold."""
        c, t = self._places(class_name, threshold_m)
        hit = self.object_row[t, self.ranked_rows[c]] >= 0
        return RankedClass(self.ranked_scores[c], hit, self.truth.number_of(class_name))

    def hit_errors(self, class_name: str) -> Float[np.ndarray, "3 k"]:
        """Errors of the hits of a class at ``tp_threshold_m``, most confident first."""
        c, t = self._places(class_name, self.protocol.tp_threshold_m)
        rows = self.ranked_rows[c]
        rows = rows[self.object_row[t, rows] >= 0]
        return self.errors_of(rows, self.object_row[t, rows])

    def errors_of(self, rows: Int[np.ndarray, "k"], object_rows: Int[np.ndarray, "k"]) -> Float[np.ndarray, "3 k"]:
        """Translation (m), scale (1 - IoU of boxes put on top of each other) and orientation (rad, 0 .. pi) errors."""
        offset = self.predictions.centre_m[rows, :2] - self.truth.centre_m[object_rows, :2]
        translation = np.sqrt(offset[:, 0] ** 2 + offset[:, 1] ** 2)
        size, true_size = self.predictions.size_m[rows], self.truth.size_m[object_rows]
        overlap = np.minimum(true_size, size).prod(axis=1)
        union = true_size.prod(axis=1) + size.prod(axis=1) - overlap
        orientation = np.abs(wrap_angle(self.truth.yaw_rad[object_rows] - self.predictions.yaw_rad[rows]))
        return np.stack([translation, 1 - overlap / union, orientation])

    def _places(self, class_name: str, threshold_m: float) -> tuple[int, int]:
        return self.protocol.classes.index(class_name), self.protocol.distance_thresholds_m.index(threshold_m)


def match(truth: BoxTable, predictions: BoxTable, protocol: Protocol) -> Matches:
    """Match greedily, by distance of centres in xy.

    In order of confidence each detection takes the nearest object of its class and sample that is still free, if it is
    nearer than the threshold; of equally near objects the first row. Detections of different samples never compete, so
    samples are matched one by one, in parallel; the outcome does not depend on the number of threads. What this computes
    is spelled out in ``reference.py``.

    Args:
        truth: objects, boxes of a sample in the same frame as its predictions.
        predictions: detections; any samples of ``truth`` in any order.
        protocol: the thresholds. Nothing is filtered here.

    Raises:
        ValueError: tables with other classes than the protocol's, or a predicted sample that is not in ``truth``.
    """
    for table in (truth, predictions):
        if table.classes != protocol.classes:
            raise ValueError(
                f"a table has the classes {list(table.classes)}, protocol '{protocol.name}' {list(protocol.classes)}"
            )
    check_samples(truth, predictions)
    thresholds_m = np.array(protocol.distance_thresholds_m)
    object_row = np.empty((len(thresholds_m), len(predictions)), dtype=np.int32)
    match_boxes(
        predictions.centre_m,
        predictions.score,
        predictions.label,
        predictions.start,
        np.array([truth.place_of[token] for token in predictions.tokens], dtype=np.int64),
        truth.centre_m,
        truth.label,
        truth.start,
        labels=len(protocol.classes),
        thresholds=thresholds_m,
        matched=object_row,
        threads=_THREADS,
    )
    return Matches(truth, predictions, protocol, object_row)


def check_samples(truth: BoxTable, predictions: BoxTable) -> None:
    """Refuse predictions of unknown samples.

    Raises:
        ValueError: a predicted sample that is not in ``truth``.
    """
    if unknown := [token for token in predictions.tokens if token not in truth.place_of]:
        raise ValueError(
            f"{len(unknown)} of {len(predictions.tokens)} predicted samples are not in the ground truth, the first is "
            f"'{unknown[0]}': are predictions and ground truth of the same recording and split?"
        )
