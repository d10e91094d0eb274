"""Augmentation of the ground plane: similarities, and boxes that follow like their corners."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coin3d.augmentation import BevAugmentation, transform_boxes
from coin3d.geometry import Boxes3D

seeds = st.integers(0, 10**6)


def random_boxes(rng: np.random.Generator, count: int = 5) -> Boxes3D:
    return Boxes3D.create(
        rng.uniform(-40, 40, (count, 3)),
        rng.uniform(0.5, 8, (count, 3)),
        rng.uniform(-np.pi, np.pi, count),
        ["car"] * count,
        scores=rng.random(count),
        velocity_mps=rng.normal(size=(count, 2)),
        num_lidar_points=rng.integers(0, 50, count),
    )


@given(seeds, st.floats(0, 90))
def test_draws_are_similarities_within_range(seed: int, degrees: float) -> None:
    drawn = BevAugmentation(degrees, 0.9, 1.2, 0.5).draw(np.random.default_rng(seed))
    scale = np.sqrt((drawn @ drawn.T)[2, 2])
    np.testing.assert_allclose(drawn @ drawn.T, scale**2 * np.eye(3), atol=1e-12)
    assert 0.9 <= scale <= 1.2
    assert drawn[2, 2] == pytest.approx(scale) and not drawn[2, :2].any() and not drawn[:2, 2].any()


def test_ranges_are_used_and_mirrors_are_fair() -> None:
    rng = np.random.default_rng(0)
    drawn = np.array([BevAugmentation().draw(rng) for _ in range(2000)])
    scale = drawn[:, 2, 2]
    assert scale.min() < 0.952 and scale.max() > 1.048
    # the mirror is applied last, so the row's sign is the mirror's: cos of the angle stays positive
    mirrored = drawn[:, [0, 1], [0, 1]] < 0
    np.testing.assert_allclose(mirrored.mean(0), 0.5, atol=0.04)
    assert (mirrored.all(1)).mean() == pytest.approx(0.25, abs=0.04)  # x and y independently
    angle = np.rad2deg(np.arccos(np.abs(drawn[:, 0, 0]) / scale))
    assert 22 < angle.max() <= 22.5 + 1e-6


def test_off_is_the_identity() -> None:
    drawn = BevAugmentation(0.0, 1.0, 1.0, 0.0).draw(np.random.default_rng(0))
    np.testing.assert_array_equal(drawn, np.eye(3))


@given(seeds)
def test_boxes_follow_like_their_corners(seed: int) -> None:
    rng = np.random.default_rng(seed)
    boxes, bev_from_ego = random_boxes(rng), BevAugmentation(90, 0.8, 1.3).draw(rng)
    moved = transform_boxes(boxes, bev_from_ego)
    expected = boxes.corners() @ bev_from_ego.T
    if np.linalg.det(bev_from_ego) < 0:
        expected = expected[:, [3, 2, 1, 0, 7, 6, 5, 4]]  # a mirror exchanges left and right; the front stays in front
    np.testing.assert_allclose(moved.corners(), expected, atol=1e-9)
    scale = bev_from_ego[2, 2]
    np.testing.assert_allclose(np.linalg.norm(moved.velocity_mps, axis=1), scale * np.linalg.norm(boxes.velocity_mps, axis=1))
    np.testing.assert_array_equal(moved.num_lidar_points, boxes.num_lidar_points)
    np.testing.assert_array_equal(moved.scores, boxes.scores)
    back = transform_boxes(moved, np.linalg.inv(bev_from_ego))
    np.testing.assert_allclose(back.corners(), boxes.corners(), atol=1e-9)


@given(seeds)
def test_points_inside_stay_inside(seed: int) -> None:
    rng = np.random.default_rng(seed)
    boxes, bev_from_ego = random_boxes(rng, 1), BevAugmentation().draw(rng)
    points = boxes.centre_m + rng.uniform(-6, 6, (50, 3))
    moved = transform_boxes(boxes, bev_from_ego)
    np.testing.assert_array_equal(moved.contains(points @ bev_from_ego.T), boxes.contains(points))


def test_heading_under_mirrors_by_hand() -> None:
    boxes = Boxes3D.create([(1, 2, 0)], [(4, 2, 1)], [0.3], ["car"], velocity_mps=[(2, 1)])
    across_y = transform_boxes(boxes, np.diag([1.0, -1.0, 1.0]))
    assert across_y.yaw_rad[0] == pytest.approx(-0.3)
    np.testing.assert_allclose([*across_y.centre_m[0], *across_y.velocity_mps[0]], [1, -2, 0, 2, -1])
    across_x = transform_boxes(boxes, np.diag([-1.0, 1.0, 1.0]))
    assert across_x.yaw_rad[0] == pytest.approx(np.pi - 0.3)
    half_turn = transform_boxes(boxes, np.diag([-1.0, -1.0, 1.0]))
    assert half_turn.yaw_rad[0] == pytest.approx(0.3 - np.pi)


def test_unknown_velocity_stays_unknown_and_no_boxes_stay_none() -> None:
    boxes = Boxes3D.create([(1, 2, 0)], [(4, 2, 1)], [0.3], ["car"])
    assert np.isnan(transform_boxes(boxes, np.diag([-1.0, 1.0, 1.0])).velocity_mps).all()
    assert len(transform_boxes(Boxes3D.empty(), np.eye(3))) == 0
