"""Groups computed by hand."""

from __future__ import annotations

import numpy as np
import pytest
from box_tables import random_detections, random_truth

from coin3d.evaluation import Protocol, evaluate, match, prediction_table, truth_table
from coin3d.evaluation.breakdown import by_camera, by_length, by_lidar_points, by_range, by_visibility
from coin3d.geometry import Boxes3D, Camera, Rig, camera_pose

CARS = Protocol(name="cars", classes=("car",))
HALF_RECALL = 40 / 90
"""AP of two objects of which one is found, without a false positive."""


def cars(xs, *, scores=None, length=4.0, points=None, visibility=None) -> Boxes3D:
    n = len(xs)
    sizes = np.column_stack([np.broadcast_to(length, n), np.full((n, 2), 1.8)])
    centre = np.column_stack([xs, np.zeros(n), np.ones(n)])
    kinds = {"scores": scores, "num_lidar_points": points, "visibility": visibility}
    return Boxes3D.create(centre, sizes, np.zeros(n), ["car"] * n, **kinds)


def matches_of(truth: Boxes3D, found: Boxes3D):
    return match(truth_table({"a": truth}, CARS), prediction_table({"a": found}, CARS), CARS)


def test_a_false_positive_counts_where_it_lies():
    """Cars at 10 m and 30 m, both found; a more confident mistake at 14.5 m: precision r/2 near, 1 far."""
    groups = by_range(matches_of(cars([10, 30]), cars([10, 30, 14.5], scores=[0.8, 0.7, 0.9]))).groups
    assert list(groups) == ["0 - 20 m", "20 - 35 m"]
    near, far = groups["0 - 20 m"]["car"], groups["20 - 35 m"]["car"]
    r = np.arange(11, 101) / 100
    assert near.ap == pytest.approx(np.maximum(r / 2 - 0.1, 0).mean() / 0.9)
    assert far.ap == pytest.approx(1)
    assert (near.num_truth, far.num_truth, near.recall, far.recall) == (1, 1, 1, 1)


def test_a_hit_counts_where_its_object_is():
    """The detection at 20.3 m is right about the car at 19.9 m: no mistake beyond 20 m, where another car is missed."""
    groups = by_range(matches_of(cars([19.9, 40, 30]), cars([20.3, 40], scores=[0.9, 0.8]))).groups
    near = groups["0 - 20 m"]["car"]
    assert near.ap == pytest.approx(1) and near.ate == pytest.approx(0.4)
    missed = groups["20 - 35 m"]["car"]
    assert (missed.ap, missed.recall, missed.ate, missed.ase, missed.aoe) == (0, 0, 1, 1, 1)
    assert groups["35 m and more"]["car"].ap == pytest.approx(1)


def test_at_a_tight_threshold_a_near_miss_is_a_false_positive_of_its_place():
    """0.6 m off: right at 1, 2 and 4 m; at 0.5 m a miss in the group of the object and a mistake in the next."""
    groups = by_range(matches_of(cars([19.8, 25]), cars([20.4, 25], scores=[0.9, 0.8]))).groups
    assert groups["0 - 20 m"]["car"].ap == pytest.approx(3 / 4)
    r = np.arange(11, 101) / 100
    mistaken = np.maximum(r / 2 - 0.1, 0).mean() / 0.9
    assert groups["20 - 35 m"]["car"].ap == pytest.approx((3 + mistaken) / 4)


def test_cameras_share_what_they_both_see():
    K = np.array([[100.0, 0, 100], [0, 100, 50], [0, 0, 1]])
    views = {"front": 0.0, "half left": 0.9, "back": np.pi}
    rig = Rig({name: Camera(K, 200, 100, camera_pose((0, 0, 1.5), yaw)) for name, yaw in views.items()})
    centre = np.array([[10, 0.0, 1], [10, 9, 1], [-10, 0, 1], [0, -10, 1]])
    truth = Boxes3D.create(centre, np.full((4, 3), 2.0), np.zeros(4), ["car"] * 4)
    mistake = Boxes3D.create([[-20, 0, 1]], [[2, 2, 2]], [0], ["car"], scores=[0.95])
    found = Boxes3D.concatenate([truth[np.array([0, 2])], mistake])
    groups = by_camera(matches_of(truth, found), {"a": rig}).groups
    assert {name: group["car"].num_truth for name, group in groups.items()} == {
        "front": 2, "half left": 1, "back": 1, "no camera": 1
    }  # fmt: skip
    assert groups["front"]["car"].ap == pytest.approx(HALF_RECALL), "the mistake behind is none of the front camera"
    assert groups["half left"]["car"].ap == groups["no camera"]["car"].ap == 0
    # equal scores but one: hit (score 1) before the mistake (0.95)
    assert groups["back"]["car"].ap == pytest.approx((89 * 0.9 + 0.4) / 90 / 0.9)


def test_length_and_lidar_points_have_recall_alone():
    truth = cars([10, 20, 30, 40], length=[3, 4.5, 4.5, 12], points=[0, 3, -1, 500])
    found = cars([10, 20, 25], scores=[0.9, 0.8, 0.99], length=4.5)
    lengths = by_length(matches_of(truth, found)).groups
    assert {g: (m["car"].num_truth, m["car"].recall) for g, m in lengths.items()} == {
        "2 - 4 m": (1, 1), "4 - 5 m": (2, 0.5), "8 m and more": (1, 0)
    }  # fmt: skip
    assert all(m["car"].ap is None for m in lengths.values())
    assert lengths["2 - 4 m"]["car"].ase == pytest.approx(1 - 3 / 4.5)
    points = by_lidar_points(matches_of(truth, found))
    assert {g: (m["car"].num_truth, m["car"].recall) for g, m in points.groups.items()} == {
        "unknown": (1, 0), "0": (1, 1), "1 - 5": (1, 1), "101 and more": (1, 0)
    }  # fmt: skip
    lines = points.table().splitlines()
    assert len({len(line) for line in lines}) == 1 and lines[0].startswith("by LiDAR points") and " - " in lines[1]


def test_visibility_has_recall_alone():
    """Hidden cars are missed; the mistake at 25 m belongs to no group."""
    truth = cars([10, 20, 30, 40, 45], visibility=[4, 1, 1, 0, 3])
    parts = by_visibility(matches_of(truth, cars([10, 30, 25, 45.5], scores=[0.9, 0.8, 0.99, 0.5])))
    assert {g: (m["car"].num_truth, m["car"].recall) for g, m in parts.groups.items()} == {
        "unknown": (1, 0), "0 - 40 %": (2, 0.5), "60 - 80 %": (1, 1), "80 - 100 %": (1, 1)
    }  # fmt: skip
    assert all(m["car"].ap is None for m in parts.groups.values())
    assert parts.groups["60 - 80 %"]["car"].ate == pytest.approx(0.5) and parts.table().startswith("by visibility")
    kept = truth_table({"a": truth}, CARS)
    assert kept.boxes_of("a").visibility.tolist() == [4, 1, 1, 0, 3]


def test_one_group_with_everything_is_the_whole():
    rng = np.random.default_rng(0)
    truth = random_truth(rng, 40, 10)
    predictions = random_detections(rng, truth)
    shrunk = [
        {
            t: Boxes3D.create(b.centre_m * [0.2, 0.2, 1], b.size_m, b.yaw_rad, b.labels, scores=b.scores)
            for t, b in table.items()
        }
        for table in (truth, predictions)
    ]
    protocol = Protocol()
    metrics = evaluate(*shrunk, protocol)
    matches = match(truth_table(shrunk[0], protocol), prediction_table(shrunk[1], protocol), protocol)
    (classes,) = by_range(matches).groups.values()
    for name, expected in metrics.classes.items():
        ours = classes[name]
        assert (ours.ap, ours.ate, ours.ase, ours.aoe) == pytest.approx((expected.ap, expected.ate, expected.ase, expected.aoe))
        assert ours.num_truth == expected.num_truth
    for parts in (by_length(matches), by_lidar_points(matches), by_visibility(matches)):
        assert sum(g["car"].num_truth for g in parts.groups.values() if "car" in g) == metrics.classes["car"].num_truth
