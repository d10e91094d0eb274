"""Which boxes take part in an evaluation. Every filter keeps the order of the rows, which decides ties of scores."""

from __future__ import annotations

import numpy as np

from coin3d.evaluation.protocol import Protocol
from coin3d.geometry import Boxes3D, Rig


def filter_truth(truth: Boxes3D, rig: Rig, protocol: Protocol) -> Boxes3D:
    """Ground truth of one sample that counts.

    Args:
        truth: boxes in the ego frame at the reference time, with the labels of the protocol; others are dropped.
        rig: the cameras of this sample; read only if the protocol says ``visible_only``.
        protocol: says which of the filters apply.
    """
    truth = truth[protocol.in_range(truth)]
    if protocol.drop_zero_lidar:
        truth = truth[truth.num_lidar_points != 0]
    return visible(truth, rig) if protocol.visible_only else truth


def filter_predictions(predictions: Boxes3D, rig: Rig, protocol: Protocol) -> Boxes3D:
    """Predictions of one sample that count: the best ``max_boxes_per_sample``, then range and visibility.

    The limit comes first because it is on what a detector hands in, not on what is left of it.
    """
    predictions = best(predictions, protocol.max_boxes_per_sample)
    predictions = predictions[protocol.in_range(predictions)]
    return visible(predictions, rig) if protocol.visible_only else predictions


def visible(boxes: Boxes3D, rig: Rig) -> Boxes3D:
    """Boxes whose centre projects into at least one image of the rig, at least ``MIN_DEPTH_M`` before the camera."""
    return boxes[rig.sees(boxes.centre_m)] if len(boxes) else boxes


def best(boxes: Boxes3D, limit: int) -> Boxes3D:
    """The ``limit`` boxes of highest score; of equal scores the later rows, as in matching."""
    if len(boxes) <= limit:
        return boxes
    return boxes[np.sort(np.argsort(boxes.scores, kind="stable")[-limit:])]
