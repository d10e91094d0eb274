"""The filters of ``filters.py`` for the samples of a whole data set at once."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool

from coin3d.evaluation.box_table import BoxTable
from coin3d.evaluation.protocol import Protocol
from coin3d.evaluation.visibility import seen_by_any
from coin3d.geometry import Rig


def counted_truth(truth: BoxTable, rigs: Mapping[str, Rig], protocol: Protocol) -> BoxTable:
    """Ground truth of which what does not count takes no part.

    Args:
        truth: boxes in the ego frame at the reference time.
        rigs: sample token -> its cameras; read only if the protocol says ``visible_only``.
        protocol: says which of the filters apply.

    Raises:
        ValueError: a sample without a rig.
    """
    counts = in_range(truth, protocol)
    if protocol.drop_zero_lidar and truth.num_lidar_points is not None:
        counts &= truth.num_lidar_points != 0
    return _visible(truth.only(counts), rigs, protocol)


def counted_predictions(predictions: BoxTable, rigs: Mapping[str, Rig], protocol: Protocol) -> BoxTable:
    """Predictions of which only the best ``max_boxes_per_sample`` of a sample take part, then by range and visibility.

    The limit comes first because it is on what a detector hands in, not on what is left of it.

    Args:
        predictions: boxes in the ego frame at the reference time.
        rigs: sample token -> its cameras; read only if the protocol says ``visible_only``.
        protocol: says which of the filters apply.

    Raises:
        ValueError: a sample without a rig.
    """
    counts = among_best(predictions, protocol.max_boxes_per_sample)
    return _visible(predictions.only(counts & in_range(predictions, protocol)), rigs, protocol)


def in_range(table: BoxTable, protocol: Protocol) -> Bool[np.ndarray, "n"]:
    """Which boxes lie within the range of their class."""
    x, y = table.centre_m[:, 0], table.centre_m[:, 1]
    distance_m = np.hypot(x, y) if protocol.range_shape == "radial" else np.maximum(np.abs(x), np.abs(y))
    # label -1 picks the last entry, which nothing is nearer than
    limit_m = np.array([*(protocol.range_m[name] for name in table.classes), 0.0])
    return np.asarray(distance_m < limit_m[table.label])


def among_best(table: BoxTable, limit: int) -> Bool[np.ndarray, "n"]:
    """Which boxes are among the ``limit`` of highest score in their sample; of equal scores the later rows, as in matching."""
    counts = np.ones(len(table), dtype=bool)
    for s in np.flatnonzero(np.diff(table.start) > limit):
        first, last = table.start[s], table.start[s + 1]
        order = np.argsort(table.score[first:last], kind="stable")
        counts[first + order[:-limit]] = False
    return counts


def _visible(table: BoxTable, rigs: Mapping[str, Rig], protocol: Protocol) -> BoxTable:
    return table.only(seen_by_any(table, rigs)) if protocol.visible_only else table
