"""AP, true-positive errors and NDS* as a pure function over two box tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, Shaped

from coin3d.evaluation.curves import RankedClass, average_precision, mean_errors
from coin3d.evaluation.matching import match_greedily
from coin3d.evaluation.protocol import Protocol
from coin3d.geometry import Boxes3D, wrap_angle


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
    check_predictions(truth, predictions, protocol)
    sample_of = {token: i for i, token in enumerate(truth)}
    objects, object_sample = _stack(truth, sample_of)
    detections, detection_sample = _stack(predictions, sample_of)
    classes = {}
    for name in protocol.classes:
        of_class = objects.labels == name
        # reversing an ascending stable sort puts the later of equal scores first
        rows = np.flatnonzero(detections.labels == name)
        rows = rows[np.argsort(detections.scores[rows], kind="stable")[::-1]]
        classes[name] = _evaluate_class(
            objects[of_class], object_sample[of_class], detections[rows], detection_sample[rows], protocol
        )
    return Metrics(classes, len(truth))


def _evaluate_class(
    objects: Boxes3D,
    object_sample: Int[np.ndarray, "m"],
    detections: Boxes3D,
    detection_sample: Int[np.ndarray, "n"],
    protocol: Protocol,
) -> ClassMetrics:
    """One class; detections most confident first."""
    thresholds_m = protocol.distance_thresholds_m
    matched = match_greedily(detections.centre_m[:, :2], detection_sample, objects.centre_m[:, :2], object_sample, thresholds_m)
    ap_at = {
        threshold_m: average_precision(RankedClass(detections.scores, matched[t] >= 0, len(objects)), protocol)
        for t, threshold_m in enumerate(thresholds_m)
    }
    at_tp = matched[thresholds_m.index(protocol.tp_threshold_m)]
    hit = at_tp >= 0
    errors = pair_errors(objects[at_tp[hit]], detections[hit])
    ate, ase, aoe = mean_errors(RankedClass(detections.scores, hit, len(objects)), errors, protocol)
    return ClassMetrics(ap_at, ate, ase, aoe, len(objects), len(detections))


def pair_errors(objects: Boxes3D, detections: Boxes3D) -> Float[np.ndarray, "3 k"]:
    """Translation (m), scale (1 - IoU of aligned boxes) and orientation (rad, 0 .. pi) errors of matched rows."""
    offset = detections.centre_m[:, :2] - objects.centre_m[:, :2]
    translation = np.sqrt(offset[:, 0] ** 2 + offset[:, 1] ** 2)
    overlap = np.minimum(objects.size_m, detections.size_m).prod(axis=1)
    union = objects.size_m.prod(axis=1) + detections.size_m.prod(axis=1) - overlap
    orientation = np.abs(wrap_angle(objects.yaw_rad - detections.yaw_rad))
    return np.stack([translation, 1 - overlap / union, orientation])


def _stack(tables: Mapping[str, Boxes3D], sample_of: Mapping[str, int]) -> tuple[Boxes3D, Int[np.ndarray, "n"]]:
    """All rows in the order of the mapping, and the sample of each."""
    samples = np.array([sample_of[token] for token in tables], dtype=np.int64)
    counts = np.array([len(boxes) for boxes in tables.values()], dtype=np.int64)
    return Boxes3D.concatenate(tables.values()), np.repeat(samples, counts)


def check_predictions(truth: Mapping[str, Boxes3D], predictions: Mapping[str, Boxes3D], protocol: Protocol) -> None:
    """Refuse predictions that cannot be scored; the errors are those of ``evaluate``."""
    unknown = [token for token in predictions if token not in truth]
    if unknown:
        raise ValueError(
            f"{len(unknown)} of {len(predictions)} predicted samples are not in the ground truth, the first is "
            f"'{unknown[0]}': are predictions and ground truth of the same recording and split?"
        )
    for token, boxes in predictions.items():
        other: Shaped[np.ndarray, "k"] = boxes.labels[~np.isin(boxes.labels, protocol.classes)]
        if len(other):
            raise ValueError(
                f"sample '{token}' has predictions of class '{other[0]}', but protocol '{protocol.name}' scores "
                f"{', '.join(protocol.classes)}: map or drop the others before scoring"
            )
        if len(boxes) and not (boxes.scores.min() >= 0 and boxes.scores.max() <= 1):
            raise ValueError(
                f"sample '{token}' has scores from {boxes.scores.min():g} to {boxes.scores.max():g}: "
                "scores are probabilities in [0, 1]; apply the sigmoid first"
            )
