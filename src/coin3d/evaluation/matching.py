"""Greedy matching of detections to objects by centre distance, for all samples at once."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int


def match_greedily(
    detection_xy_m: Float[np.ndarray, "n 2"],
    detection_sample: Int[np.ndarray, "n"],
    object_xy_m: Float[np.ndarray, "m 2"],
    object_sample: Int[np.ndarray, "m"],
    thresholds_m: tuple[float, ...],
) -> Int[np.ndarray, "t n"]:
    """Which object each detection of one class takes, at each threshold.

    In order of confidence each detection takes the nearest object of its sample that is still free, if it is nearer
    than the threshold; of equally near objects the first row. Detections of different samples never compete, so the
    k-th detections of all samples are matched together: the loop is as long as the fullest sample, not the data set.

    Args:
        detection_xy_m: centres, most confident first.
        detection_sample: sample of each detection, 0 .. S-1.
        object_xy_m: centres of the ground truth, in the same frame as the detections of the same sample.
        object_sample: sample of each object.
        thresholds_m: largest distances of a match (exclusive).

    Returns:
        (T, N) row of the matched object, -1 for a false positive.
    """
    matched = np.full((len(thresholds_m), len(detection_xy_m)), -1, dtype=np.int64)
    if not len(detection_xy_m) or not len(object_xy_m):
        return matched
    num_samples = 1 + int(max(detection_sample.max(), object_sample.max()))
    slot = _rank_in_group(object_sample, num_samples)
    objects = np.full((num_samples, 1 + int(slot.max())), -1, dtype=np.int64)
    objects[object_sample, slot] = np.arange(len(object_xy_m))
    xy = np.full((*objects.shape, 2), np.inf)
    xy[object_sample, slot] = object_xy_m
    taken = np.zeros((len(thresholds_m), *objects.shape), dtype=bool)

    reach_m = max(thresholds_m)
    turn = _rank_in_group(detection_sample, num_samples)
    by_turn = np.argsort(turn, kind="stable")
    for rows in np.split(by_turn, np.flatnonzero(np.diff(turn[by_turn])) + 1):
        offset = xy[detection_sample[rows]] - detection_xy_m[rows, None]
        distance_m = np.sqrt(offset[..., 0] ** 2 + offset[..., 1] ** 2)
        near = distance_m.min(axis=1) < reach_m
        rows, distance_m = rows[near], distance_m[near]
        sample = detection_sample[rows]
        for t, threshold_m in enumerate(thresholds_m):
            free_m = np.where(taken[t, sample], np.inf, distance_m)
            nearest = free_m.argmin(axis=1)
            hit = free_m[np.arange(len(rows)), nearest] < threshold_m
            taken[t, sample[hit], nearest[hit]] = True
            matched[t, rows[hit]] = objects[sample[hit], nearest[hit]]
    return matched


def _rank_in_group(group: Int[np.ndarray, "n"], num_groups: int) -> Int[np.ndarray, "n"]:
    """0 for the first row of each group, 1 for its second, and so on."""
    order = np.argsort(group, kind="stable")
    counts = np.bincount(group, minlength=num_groups)
    first = np.cumsum(counts) - counts
    rank = np.empty(len(group), dtype=np.int64)
    rank[order] = np.arange(len(group)) - first[group[order]]
    return rank
