"""Predictions are mapped to the scored classes as annotations are."""

from __future__ import annotations

import numpy as np
import pytest

from coin3d.commands.evaluate import class_map_for
from coin3d.datasets.classes import MERGED_CAR, PLAIN_CAR, THREE_CLASS, ClassMap
from coin3d.evaluation import Protocol
from coin3d.geometry import Boxes3D
from coin3d.training.predict import score_frames
from coin3d.training.released.sources import source_named
from small_world import frame, ring_rig

TEN = source_named("petr-vov").classes


def test_ten_classes_are_scored_as_the_unified_ones() -> None:
    one = frame(0, ring_rig(6))
    truth = one.boxes
    assert truth is not None
    names = np.where(truth.labels == "car", "truck", truth.labels)
    found = Boxes3D.create(truth.centre_m, truth.size_m, truth.yaw_rad, names, scores=np.full(len(truth), 0.9))
    cone = Boxes3D.create([[5.0, 0, 0.5]], [[0.4, 0.4, 1.0]], [0.0], ["traffic_cone"], scores=[0.8])
    found = Boxes3D.concatenate([found, cone])

    def mean_ap(class_map: ClassMap, boxes: Boxes3D) -> float:
        protocol = Protocol("test", classes=class_map.classes, visible_only=False, drop_zero_lidar=False)
        return score_frames([one], {one.token: boxes}, class_map, protocol).metrics.mean_ap

    assert mean_ap(MERGED_CAR, found) == pytest.approx(1.0)
    assert mean_ap(PLAIN_CAR, found) == 0.0  # trucks are no cars in the narrow sense


def test_the_class_map_of_a_detector() -> None:
    assert class_map_for(None, TEN) is THREE_CLASS and class_map_for("plain-car", TEN) is PLAIN_CAR
    assert class_map_for(None, ("car",)) is MERGED_CAR
    with pytest.raises(ValueError, match="three-class scores two-wheel, but this checkpoint only knows car, pedestrian"):
        class_map_for(None, ("car", "pedestrian"))
