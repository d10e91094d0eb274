from __future__ import annotations

import numpy as np
import pytest

from coin3d.evaluation import Protocol, filter_predictions, filter_truth
from coin3d.evaluation.filters import best
from coin3d.geometry import Boxes3D, Camera, Rig, camera_pose, preset_rig

OPEN = {"visible_only": False, "drop_zero_lidar": False}


def boxes_at(xy, labels="car", **extra) -> Boxes3D:
    xy = np.asarray(xy, dtype=float)
    n = len(xy)
    names = [labels] * n if isinstance(labels, str) else labels
    return Boxes3D.create(np.column_stack([xy, np.ones(n)]), np.ones((n, 3)), np.zeros(n), names, **extra)


@pytest.fixture(scope="module")
def front_rig() -> Rig:
    """One camera looking forward with a field of view of 90 degrees."""
    return Rig({"front": Camera(np.array([[100.0, 0, 100], [0, 100, 50], [0, 0, 1]]), 200, 100, camera_pose((1, 0, 1.5), 0.0))})


def test_description_holds_every_number():
    line = Protocol(max_boxes_per_sample=123, min_recall=0.2, min_precision=0.3).describe()
    assert "\n" not in line
    for part in ("car 50 m", "pedestrian 40 m", "two-wheel 40 m", "radial", "0.5/1/2/4", "at 2 m", "0.2", "0.3", "123"):
        assert part in line
    assert "seen by a camera" in line and "without LiDAR points dropped" in line
    loose = Protocol(range_shape="square", **OPEN).describe()
    assert "square" in loose and "seen by a camera or not" in loose and "without LiDAR points kept" in loose


@pytest.mark.parametrize(
    ("rules", "message"),
    [
        ({"classes": ()}, "one or more"),
        ({"classes": ("car", "car")}, "different names"),
        ({"classes": ("car", "boat")}, "no range for boat"),
        ({"range_m": {"car": 0.0, "pedestrian": 40.0, "two-wheel": 40.0}}, "positive"),
        ({"range_m": {"car": float("nan"), "pedestrian": 40.0, "two-wheel": 40.0}}, "positive"),
        ({"distance_thresholds_m": (1.0, -2.0)}, "positive metres"),
        ({"distance_thresholds_m": (2.0, 2.0)}, "different"),
        ({"tp_threshold_m": 3.0}, "not one of"),
        ({"min_recall": 1.0}, "min_recall"),
        ({"min_precision": 1.0}, "min_precision"),
        ({"max_boxes_per_sample": 0}, "at least 1"),
    ],
)
def test_rules_that_contradict_are_refused(rules, message):
    with pytest.raises(ValueError, match=message):
        Protocol(**rules)


def test_unknown_range_shape_is_refused():
    # TypeError where the types of arguments are checked at run time
    with pytest.raises((ValueError, TypeError), match="radial"):
        Protocol(range_shape="round")


def test_radial_and_square_range():
    boxes = boxes_at([(49.9, 0), (50, 0), (40, 40), (-49.9, 49.9), (0, -50.1)])
    assert Protocol(**OPEN).in_range(boxes).tolist() == [True, False, False, False, False]
    assert Protocol(range_shape="square", **OPEN).in_range(boxes).tolist() == [True, False, True, True, False]


def test_each_class_has_its_range_and_others_have_none(front_rig):
    boxes = boxes_at([(45, 0)] * 4, ["car", "pedestrian", "two-wheel", "barrier"])
    assert filter_truth(boxes, front_rig, Protocol(**OPEN)).labels.tolist() == ["car"]


def test_only_boxes_in_front_of_a_camera_count(front_rig):
    boxes = boxes_at([(10, 0), (10, 8.9), (10, 9.1), (-10, 0), (1.4, 0), (1.6, 0.05)])
    # the camera sits at x = 1: |y| < x - 1, and z = x - 1 > 0.5
    for kept in (filter_truth(boxes, front_rig, Protocol()), filter_predictions(boxes, front_rig, Protocol())):
        assert kept.centre_m[:, 1].tolist() == [0, 8.9]
    low = Boxes3D.create([[1.6, 0, 1.5]], [[1, 1, 1]], [0], ["car"])
    assert len(filter_truth(low, front_rig, Protocol())) == 1, "0.6 m before the image plane is enough"
    assert len(filter_truth(boxes, front_rig, Protocol(**OPEN))) == 6


def test_waymo_has_no_eyes_behind():
    around = boxes_at([(20 * np.cos(a), 20 * np.sin(a)) for a in np.deg2rad(np.arange(0, 360, 10))])
    kept = filter_truth(around, preset_rig("waymo"), Protocol())
    angles = np.rad2deg(np.arctan2(kept.centre_m[:, 1], kept.centre_m[:, 0]))
    assert 20 < len(kept) < 28 and np.abs(angles).max() < 130
    assert len(filter_truth(around, preset_rig("nuscenes"), Protocol())) == 36


def test_only_known_zero_counts_drop_truth(front_rig):
    boxes = boxes_at([(10, 0), (11, 0), (12, 0)], num_lidar_points=[0, -1, 3])
    assert filter_truth(boxes, front_rig, Protocol()).centre_m[:, 0].tolist() == [11, 12]
    assert len(filter_truth(boxes, front_rig, Protocol(drop_zero_lidar=False))) == 3
    assert len(filter_predictions(boxes, front_rig, Protocol())) == 3, "predictions have no counts"


def test_limit_keeps_the_best_in_their_order(front_rig):
    boxes = boxes_at([(10 + i, 0) for i in range(5)], scores=[0.5, 0.9, 0.5, 0.1, 0.5])
    assert best(boxes, 3).centre_m[:, 0].tolist() == [11, 12, 14]
    assert best(boxes, 5) is boxes
    far = boxes_at([(80, 0), (10, 0)], scores=[0.9, 0.8])
    assert len(filter_predictions(far, front_rig, Protocol(max_boxes_per_sample=1))) == 0, "the limit comes before the range"


def test_empty_tables_pass(front_rig):
    for shape in ("radial", "square"):
        assert len(filter_truth(Boxes3D.empty(), front_rig, Protocol(range_shape=shape))) == 0
        assert len(filter_predictions(Boxes3D.empty(), front_rig, Protocol(range_shape=shape))) == 0
