"""The metric once more, with plain loops in float64: slow, short, and the oracle for the fast one in tests."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from coin3d.evaluation.metrics import ClassMetrics, Metrics
from coin3d.evaluation.protocol import Protocol
from coin3d.geometry import Boxes3D

_GRID = np.linspace(0, 1, 101)  # not step / 100: the last bits decide whether a recall of exactly 0.57 is reached

Hit = tuple[float, tuple[float, float, float] | None]
"""Score, and the (translation, scale, orientation) errors of a true positive."""


def evaluate_slowly(truth: Mapping[str, Boxes3D], predictions: Mapping[str, Boxes3D], protocol: Protocol) -> Metrics:
    """What ``metrics.evaluate`` computes, for inputs that it accepts."""
    classes = {}
    for name in protocol.classes:
        num_truth = sum(int((boxes.labels == name).sum()) for boxes in truth.values())
        num_predictions = sum(int((boxes.labels == name).sum()) for boxes in predictions.values())
        ap_at = {}
        ate = ase = aoe = 1.0
        for threshold_m in protocol.distance_thresholds_m:
            hits = _ranked_hits(truth, predictions, name, threshold_m)
            ap_at[threshold_m] = _ap(hits, num_truth, protocol)
            if threshold_m == protocol.tp_threshold_m:
                ate, ase, aoe = (_error(hits, num_truth, protocol, which) for which in range(3))
        classes[name] = ClassMetrics(ap_at, ate, ase, aoe, num_truth, num_predictions)
    return Metrics(classes, len(truth))


def _ranked_hits(truth: Mapping[str, Boxes3D], predictions: Mapping[str, Boxes3D], name: str, threshold_m: float) -> list[Hit]:
    ranked: list[tuple[float, int, str, int]] = []
    for token, boxes in predictions.items():
        for row in range(len(boxes)):
            if boxes.labels[row] == name:
                ranked.append((float(boxes.scores[row]), len(ranked), token, row))
    ranked.sort(reverse=True)
    taken = set()
    hits: list[Hit] = []
    for score, _, token, row in ranked:
        objects, detections = truth[token], predictions[token]
        nearest, nearest_m = None, math.inf
        for other in range(len(objects)):
            if objects.labels[other] == name and (token, other) not in taken:
                distance_m = math.dist(objects.centre_m[other, :2], detections.centre_m[row, :2])
                if distance_m < nearest_m:
                    nearest, nearest_m = other, distance_m
        if nearest is None or nearest_m >= threshold_m:
            hits.append((score, None))
            continue
        taken.add((token, nearest))
        overlap = volume_a = volume_b = 1.0
        for a, b in zip(objects.size_m[nearest], detections.size_m[row], strict=True):
            overlap, volume_a, volume_b = overlap * min(a, b), volume_a * a, volume_b * b
        turn = (objects.yaw_rad[nearest] - detections.yaw_rad[row]) % (2 * math.pi)
        hits.append((score, (nearest_m, 1 - overlap / (volume_a + volume_b - overlap), min(turn, 2 * math.pi - turn))))
    return hits


def _recalls(hits: list[Hit], num_truth: int) -> list[float]:
    found, recalls = 0, []
    for _, errors in hits:
        found += errors is not None
        recalls.append(found / num_truth)
    return recalls


def _ap(hits: list[Hit], num_truth: int, protocol: Protocol) -> float:
    if all(errors is None for _, errors in hits):
        return 0.0
    recalls = _recalls(hits, num_truth)
    precisions = [recall * num_truth / (i + 1) for i, recall in enumerate(recalls)]
    total, count = 0.0, 0
    for step in range(round(100 * protocol.min_recall) + 1, 101):
        precision = float(np.interp(_GRID[step], recalls, precisions, right=0.0))
        total += max(0.0, precision - protocol.min_precision)
        count += 1
    return total / count / (1 - protocol.min_precision)


def _error(hits: list[Hit], num_truth: int, protocol: Protocol, which: int) -> float:
    found = [(score, errors[which]) for score, errors in hits if errors is not None]
    if not found:
        return 1.0
    recalls = _recalls(hits, num_truth)
    running, total = [], 0.0
    for i, (_, error) in enumerate(found):
        total += error
        running.append(total / (i + 1))
    grid = [float(np.interp(_GRID[step], recalls, [score for score, _ in hits], right=0.0)) for step in range(101)]
    last = max((step for step in range(101) if grid[step] > 0), default=0)
    ascending_scores, ascending_running = [score for score, _ in found][::-1], running[::-1]
    values = [
        float(np.interp(grid[step], ascending_scores, ascending_running))
        for step in range(round(100 * protocol.min_recall) + 1, last + 1)
    ]
    return sum(values) / len(values) if values else 1.0
