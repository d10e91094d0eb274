"""Filter, evaluate, and put the protocol beside the numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from coin3d.evaluation.filters import filter_predictions, filter_truth
from coin3d.evaluation.metrics import ClassMetrics, Metrics, check_predictions, evaluate
from coin3d.evaluation.protocol import Protocol
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
    if not truth:
        raise ValueError("there are no samples to score: the ground truth is empty")
    if missing := [token for token in truth if token not in rigs]:
        raise ValueError(f"{len(missing)} samples have no rig, the first is '{missing[0]}'")
    labels = {str(label) for boxes in truth.values() for label in boxes.labels}
    if labels and not labels & set(protocol.classes):
        raise ValueError(
            f"no ground truth of the classes {', '.join(protocol.classes)}: found {', '.join(sorted(labels)[:8])}; "
            "map the data set's categories first (coin3d.datasets.classes)"
        )
    # before the range filter, which would silently drop classes that are not scored
    check_predictions(truth, predictions, protocol)
    unfiltered = replace(protocol, visible_only=False, drop_zero_lidar=False)
    open_metrics = _filter_and_evaluate(truth, predictions, rigs, unfiltered)
    metrics = open_metrics if unfiltered == protocol else _filter_and_evaluate(truth, predictions, rigs, protocol)
    return Report(protocol, metrics, open_metrics)


def _filter_and_evaluate(
    truth: Mapping[str, Boxes3D], predictions: Mapping[str, Boxes3D], rigs: Mapping[str, Rig], protocol: Protocol
) -> Metrics:
    kept_truth = {token: filter_truth(boxes, rigs[token], protocol) for token, boxes in truth.items()}
    kept_predictions = {token: filter_predictions(boxes, rigs[token], protocol) for token, boxes in predictions.items()}
    return evaluate(kept_truth, kept_predictions, protocol)


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
