"""AP, true-positive errors and NDS* as a pure function over two box tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Shaped

from coin3d.evaluation.box_table import BoxTable
from coin3d.evaluation.curves import average_precision, mean_errors
from coin3d.evaluation.matching import Matches, match
from coin3d.evaluation.protocol import Protocol
from coin3d.geometry import Boxes3D


@dataclass(frozen=True)
class ClassMetrics:
    """Result of one class.

    Args:
        ap_at: distance threshold in metres -> average precision.
        ate: translation error in metres (xy).
        ase: scale error, 1 - intersection over union of the boxes put on top of each other.
        aoe: orientation error in radians, up to pi.
        num_truth: objects that counted.
        num_predictions: detections that counted.
    """

    ap_at: Mapping[float, float]
    ate: float
    ase: float
    aoe: float
    num_truth: int
    num_predictions: int

    @property
    def ap(self) -> float:
        """Mean over the distance thresholds."""
        return float(np.mean(list(self.ap_at.values())))

    @property
    def nds_star(self) -> float:
        """NDS* of this class alone."""
        return nds_star(self.ap, self.ate, self.ase, self.aoe)


@dataclass(frozen=True)
class Metrics:
    """Result of all classes. A class without objects counts as AP 0 and errors 1, as in the nuScenes devkit."""

    classes: Mapping[str, ClassMetrics]
    num_samples: int

    @property
    def mean_ap(self) -> float:
        return float(np.mean([c.ap for c in self.classes.values()]))

    @property
    def mean_ate(self) -> float:
        return float(np.mean([c.ate for c in self.classes.values()]))

    @property
    def mean_ase(self) -> float:
        return float(np.mean([c.ase for c in self.classes.values()]))

    @property
    def mean_aoe(self) -> float:
        return float(np.mean([c.aoe for c in self.classes.values()]))

    @property
    def nds_star(self) -> float:
        """NDS*, paper eq. nds*."""
        return nds_star(self.mean_ap, self.mean_ate, self.mean_ase, self.mean_aoe)

    @property
    def num_truth(self) -> int:
        return sum(c.num_truth for c in self.classes.values())

    @property
    def num_predictions(self) -> int:
        return sum(c.num_predictions for c in self.classes.values())


def nds_star(ap: float, ate: float, ase: float, aoe: float) -> float:
    """(3 mAP + sum over the three errors of 1 - min(1, error)) / 6, paper eq. nds*."""
    return (3 * ap + sum(1 - min(1.0, error) for error in (ate, ase, aoe))) / 6


def evaluate(truth: Mapping[str, Boxes3D], predictions: Mapping[str, Boxes3D], protocol: Protocol) -> Metrics:
    """Score predictions against ground truth, without any filter.

    Only centre distances in xy, sizes and differences of heading enter, so any frame with z up will do as long as
    truth and predictions of a sample share it. Equal scores: the later row of the later sample goes first, which is
    the order of the nuScenes devkit.

    Args:
        truth: sample token -> boxes. Boxes of classes the protocol does not name are ignored.
        predictions: sample token -> boxes with scores in [0, 1]; samples that are left out have no predictions.
        protocol: classes and thresholds.

    Raises:
        ValueError: a prediction for a sample that is not in ``truth``, of a class that is not scored, or with a score
            outside [0, 1].
    """
    return metrics_of(match(BoxTable.from_boxes(truth, protocol.classes), prediction_table(predictions, protocol), protocol))


def metrics_of(matches: Matches) -> Metrics:
    """The numbers of matched tables."""
    return Metrics({name: _class_metrics(matches, name) for name in matches.protocol.classes}, len(matches.truth.tokens))


def _class_metrics(matches: Matches, name: str) -> ClassMetrics:
    protocol = matches.protocol
    ap_at = {}
    ate = ase = aoe = 1.0
    for threshold_m in protocol.distance_thresholds_m:
        ranked = matches.ranked(name, threshold_m)
        ap_at[threshold_m] = average_precision(ranked, protocol)
        if threshold_m == protocol.tp_threshold_m:
            ate, ase, aoe = mean_errors(ranked, matches.hit_errors(name), protocol)
    return ClassMetrics(ap_at, ate, ase, aoe, matches.truth.number_of(name), matches.predictions.number_of(name))


def prediction_table(predictions: Mapping[str, Boxes3D], protocol: Protocol) -> BoxTable:
    """Predictions in columns.

    Raises:
        ValueError: a class that is not scored, or a score outside [0, 1].
    """
    table = BoxTable.from_boxes(predictions, protocol.classes)
    if len(other := np.flatnonzero(table.label < 0)):
        token = table.token_of(int(other[0]))
        names: Shaped[np.ndarray, "k"] = predictions[token].labels
        raise ValueError(
            f"sample '{token}' has predictions of class '{names[other[0] - table.start[table.place_of[token]]]}', but protocol "
            f"'{protocol.name}' scores {', '.join(protocol.classes)}: map or drop the others before scoring"
        )
    check_scores(table)
    return table


def check_scores(predictions: BoxTable) -> None:
    """Refuse scores that are no probabilities.

    Raises:
        ValueError: a score outside [0, 1].
    """
    score = predictions.score
    if len(score) and (score.min() < 0 or score.max() > 1):
        token = predictions.token_of(int(np.argmax((score < 0) | (score > 1))))
        place = predictions.place_of[token]
        own = score[predictions.start[place] : predictions.start[place + 1]]
        raise ValueError(
            f"sample '{token}' has scores from {own.min():g} to {own.max():g}: "
            "scores are probabilities in [0, 1]; apply the sigmoid first"
        )
