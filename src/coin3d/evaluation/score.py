"""Filter, evaluate, and put the protocol beside the numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from coin3d.datasets.classes import ClassMap
from coin3d.datasets.frame import Frame
from coin3d.evaluation.box_table import BoxTable
from coin3d.evaluation.matching import Matches, check_samples, match
from coin3d.evaluation.metrics import ClassMetrics, Metrics, check_scores, metrics_of, prediction_table
from coin3d.evaluation.protocol import Protocol
from coin3d.evaluation.table_filters import counted_predictions, counted_truth
from coin3d.geometry import Boxes3D, Rig


@dataclass(frozen=True)
class Report:
    """Metrics under a protocol, and the same without its visibility and LiDAR filters.

    Args:
        protocol: the rules.
        metrics: the result.
        unfiltered: the result when objects and predictions outside every image and objects without LiDAR points count
            too (range and box limit stay).
    """

    protocol: Protocol
    metrics: Metrics
    unfiltered: Metrics

    def row(self) -> dict[str, Any]:
        """Plain numbers for ``result.json``."""
        return {
            **_means(self.metrics),
            "samples": self.metrics.num_samples,
            "truth_boxes": self.metrics.num_truth,
            "predicted_boxes": self.metrics.num_predictions,
            "classes": {name: _class_row(c) for name, c in self.metrics.classes.items()},
            "unfiltered": {
                **_means(self.unfiltered),
                "truth_boxes": self.unfiltered.num_truth,
                "predicted_boxes": self.unfiltered.num_predictions,
            },
            "protocol": self.protocol.describe(),
        }

    def table(self) -> str:
        """Plain text: one line per class, their mean, the unfiltered mean, the protocol."""
        thresholds = [f"AP@{t:g}" for t in self.protocol.distance_thresholds_m]
        lines = [_line("class", ["truth", "pred", "AP", *thresholds, "ATE", "ASE", "AOE", "NDS*"])]
        for name, c in self.metrics.classes.items():
            numbers = [c.ap, *c.ap_at.values(), c.ate, c.ase, c.aoe, c.nds_star]
            lines.append(_line(name, [str(c.num_truth), str(c.num_predictions), *(f"{x:.3f}" for x in numbers)]))
        for name, m in (("mean", self.metrics), ("unfiltered", self.unfiltered)):
            counts = [str(m.num_truth), str(m.num_predictions)]
            ap_at = [sum(c.ap_at[t] for c in m.classes.values()) / len(m.classes) for t in self.protocol.distance_thresholds_m]
            numbers = [m.mean_ap, *ap_at, m.mean_ate, m.mean_ase, m.mean_aoe, m.nds_star]
            lines.append(_line(name, [*counts, *(f"{x:.3f}" for x in numbers)]))
        lines.append(f"{self.metrics.num_samples} samples. {self.protocol.describe()}")
        return "\n".join(lines)


def annotated_boxes(frames: Iterable[Frame], class_map: ClassMap) -> dict[str, Boxes3D]:
    """Token -> annotated boxes in the ego frame, with the classes of the map.

    Raises:
        ValueError: a frame without annotations.
    """
    truth = {}
    for frame in frames:
        if frame.boxes is None:
            raise ValueError(f"frame {frame.token} has no annotations to score against; coin3d detect needs none")
        truth[frame.token] = class_map.apply(frame.boxes)
    return truth


def score(
    truth: Mapping[str, Boxes3D], predictions: Mapping[str, Boxes3D], rigs: Mapping[str, Rig], protocol: Protocol
) -> Report:
    """Score predictions under a protocol.

    Args:
        truth: sample token -> boxes in the ego frame at the reference time, labels mapped to the protocol's classes
            (others are ignored).
        predictions: sample token -> boxes in the same frame; samples that are left out have no predictions.
        rigs: sample token -> the cameras of that sample.
        protocol: the rules.

    Raises:
        ValueError: no samples; a sample without a rig; ground truth of which no box has a scored class; or what
            ``evaluate`` refuses.
    """
    return score_tables(truth_table(truth, protocol), prediction_table(predictions, protocol), rigs, protocol)[0]


def truth_table(truth: Mapping[str, Boxes3D], protocol: Protocol) -> BoxTable:
    """Ground truth in columns; boxes of classes the protocol does not name take no part.

    Raises:
        ValueError: boxes, but none with a scored class.
    """
    labels = {str(label) for boxes in truth.values() for label in np.unique(boxes.labels)}
    if labels and not labels & set(protocol.classes):
        raise ValueError(
            f"no ground truth of the classes {', '.join(protocol.classes)}: found {', '.join(sorted(labels)[:8])}; "
            "map the data set's categories first (coin3d.datasets.classes)"
        )
    return BoxTable.from_boxes(truth, protocol.classes)


def score_tables(truth: BoxTable, predictions: BoxTable, rigs: Mapping[str, Rig], protocol: Protocol) -> tuple[Report, Matches]:
    """Score tables under a protocol.

    Args:
        truth: boxes in the ego frame at the reference time, with the protocol's classes.
        predictions: boxes in the same frame; samples that are left out have no predictions.
        rigs: sample token -> the cameras of that sample.
        protocol: the rules.

    Returns:
        The report, and the matches behind it, from which breakdowns, curves and intervals are made.

    Raises:
        ValueError: no samples, a sample without a rig, scores that are no probabilities, or what ``match`` refuses.
    """
    if not truth.tokens:
        raise ValueError("there are no samples to score: the ground truth is empty")
    if missing := [token for token in truth.tokens if token not in rigs]:
        raise ValueError(f"{len(missing)} samples have no rig, the first is '{missing[0]}'")
    check_samples(truth, predictions)
    check_scores(predictions)
    unfiltered = replace(protocol, visible_only=False, drop_zero_lidar=False)
    # first, so that its matches are gone when the others are made
    open_metrics = None if unfiltered == protocol else metrics_of(_filter_and_match(truth, predictions, rigs, unfiltered))
    matches = _filter_and_match(truth, predictions, rigs, protocol)
    metrics = metrics_of(matches)
    return Report(protocol, metrics, open_metrics or metrics), matches


def _filter_and_match(truth: BoxTable, predictions: BoxTable, rigs: Mapping[str, Rig], protocol: Protocol) -> Matches:
    return match(counted_truth(truth, rigs, protocol), counted_predictions(predictions, rigs, protocol), protocol)


def _means(metrics: Metrics) -> dict[str, float]:
    return {
        "mAP": metrics.mean_ap,
        "mATE": metrics.mean_ate,
        "mASE": metrics.mean_ase,
        "mAOE": metrics.mean_aoe,
        "NDS*": metrics.nds_star,
    }


def _class_row(c: ClassMetrics) -> dict[str, Any]:
    return {
        "AP": c.ap,
        "AP_at": {f"{t:g}": ap for t, ap in c.ap_at.items()},
        "ATE": c.ate,
        "ASE": c.ase,
        "AOE": c.aoe,
        "NDS*": c.nds_star,
        "truth_boxes": c.num_truth,
        "predicted_boxes": c.num_predictions,
    }


def _line(name: str, cells: list[str]) -> str:
    return f"{name:<12}" + "".join(f"{cell:>8}" for cell in cells)
