"""Box tables: corners, containment, frames, rows and what is rejected."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from coin3d.geometry import Boxes3D, Pose, wrap_angle

Triple = tuple[float, float, float]


def one(centre: Triple = (0, 0, 0), size: Triple = (4, 2, 1.5), yaw: float = 0.0, **more: ArrayLike) -> Boxes3D:
    return Boxes3D.create([centre], [size], [yaw], ["car"], **more)


def test_corners_by_hand() -> None:
    corners = one((10, 5, 1)).corners()[0]
    bottom = [(12, 6), (8, 6), (8, 4), (12, 4)]  # front left, rear left, rear right, front right
    np.testing.assert_allclose(corners[:4], [(*xy, 0.25) for xy in bottom])
    np.testing.assert_allclose(corners[4:], [(*xy, 1.75) for xy in bottom])
    turned = one((10, 5, 1), yaw=np.pi / 2).corners()[0]
    np.testing.assert_allclose(turned[0], (9, 7, 0.25), atol=1e-12)  # front is now +y, its left -x


def test_contains_by_hand() -> None:
    box = one((1, 0, 0), yaw=np.pi / 2)
    points = np.array([[1.0, 1.9, 0], [2.9, 0, 0], [1.0, 2.0, 0.75], [1, 0, 0.76], [0.01, -1.99, -0.74]])
    assert box.contains(points).tolist() == [[True, False, True, False, True]]
    assert box.count_points(points).tolist() == [3]


angle = st.floats(-np.pi, np.pi)
metres = st.floats(-30, 30)


@given(metres, metres, angle, angle, metres, metres)
def test_moving_boxes_moves_their_corners(x: float, y: float, yaw: float, turn: float, dx: float, dy: float) -> None:
    box = one((x, y, 1.0), yaw=yaw, velocity_mps=[(3.0, 1.0)])
    move = Pose.from_euler(turn, 0, 0, (dx, dy, 0.5))
    moved = box.transformed(move)
    np.testing.assert_allclose(moved.corners(), move.apply(box.corners()), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(moved.velocity_mps), np.sqrt(10))
    assert -np.pi < moved.yaw_rad[0] <= np.pi
    back = moved.transformed(move.inverse())
    np.testing.assert_allclose(back.corners(), box.corners(), atol=1e-9)
    points = np.random.default_rng(0).uniform(-3, 3, (50, 3)) + box.centre_m
    np.testing.assert_array_equal(moved.contains(move.apply(points)), box.contains(points))


def test_boxes_stay_upright_under_tilt() -> None:
    tilted = one((10, 0, 0)).transformed(Pose.from_euler(0.5, 0.1, 0, (0, 0, 0)))
    assert tilted.yaw_rad[0] == pytest.approx(0.5)
    np.testing.assert_allclose(tilted.corners()[0, :4, 2], tilted.corners()[0, 0, 2])


def test_unknown_velocity_stays_unknown() -> None:
    boxes = Boxes3D.create(np.zeros((2, 3)), np.ones((2, 3)), [0, 0], ["a", "b"], velocity_mps=[(np.nan, np.nan), (1, 0)])
    moved = boxes.transformed(Pose.from_euler(np.pi / 2, 0, 0, (0, 0, 0)))
    assert np.isnan(moved.velocity_mps[0]).all()
    np.testing.assert_allclose(moved.velocity_mps[1], (0, 1), atol=1e-12)


@given(st.floats(-1000, 1000))
def test_wrap_angle(angle_rad: float) -> None:
    wrapped = float(wrap_angle(angle_rad))
    assert -np.pi < wrapped <= np.pi
    np.testing.assert_allclose([np.cos(wrapped), np.sin(wrapped)], [np.cos(angle_rad), np.sin(angle_rad)], atol=1e-9)


def test_wrap_angle_at_the_seam() -> None:
    np.testing.assert_allclose(wrap_angle([np.pi, -np.pi, 3 * np.pi, 0.0, np.pi + 0.1]), [np.pi, np.pi, np.pi, 0, 0.1 - np.pi])


def test_rows_and_defaults() -> None:
    boxes = Boxes3D.create([(0, 0, 0), (1, 1, 1), (2, 2, 2)], np.ones((3, 3)), [0, 7, -7], ["car", "pedestrian", "car"])
    assert len(boxes) == 3 and boxes[boxes.labels == "car"].centre_m[:, 0].tolist() == [0, 2]
    assert boxes[1:].labels.tolist() == ["pedestrian", "car"] and boxes[np.array([2, 0])].centre_m[0, 0] == 2
    assert boxes.scores.tolist() == [1, 1, 1] and boxes.num_lidar_points.tolist() == [-1, -1, -1]
    assert boxes.instance_ids.tolist() == ["", "", ""] and np.isnan(boxes.velocity_mps).all()
    assert (np.abs(boxes.yaw_rad) <= np.pi).all()
    assert boxes.with_labels(["x", "y", "a longer name"]).labels.tolist() == ["x", "y", "a longer name"]


def test_visibility_goes_where_the_boxes_go() -> None:
    boxes = Boxes3D.create(np.eye(3), np.ones((3, 3)), [0, 1, 2], ["a", "b", "c"], visibility=[4, 0, 1])
    assert one().visibility.tolist() == [0]
    assert boxes[np.array([2, 0])].visibility.tolist() == [1, 4] and boxes[boxes.visibility > 0].labels.tolist() == ["a", "c"]
    assert boxes.transformed(Pose.from_euler(1, 0.1, 0, (1, 2, 3))).visibility.tolist() == [4, 0, 1]
    assert boxes.with_labels(["x", "y", "z"]).visibility.tolist() == [4, 0, 1]
    assert Boxes3D.concatenate([one(), boxes]).visibility.tolist() == [0, 4, 0, 1]


@pytest.mark.parametrize("level", [-1, 5, 300])
def test_a_visibility_that_is_no_level(level: int) -> None:
    with pytest.raises(ValueError, match=f"box 1 has the visibility {level}: levels are 1 to 4, and 0 where it is unknown"):
        Boxes3D.create(np.zeros((2, 3)), np.ones((2, 3)), [0, 0], ["a", "b"], visibility=[1, level])


def test_empty_tables() -> None:
    empty = Boxes3D.empty()
    assert len(empty) == 0 and empty.corners().shape == (0, 8, 3) and empty.contains(np.zeros((5, 3))).shape == (0, 5)
    assert len(empty.transformed(Pose.identity())) == 0 and len(Boxes3D.concatenate([])) == 0
    assert empty.count_points(np.zeros((5, 3))).tolist() == []
    joined = Boxes3D.concatenate([empty, one(), one((1, 0, 0))])
    assert len(joined) == 2 and joined.centre_m[:, 0].tolist() == [0, 1] and joined.labels.tolist() == ["car", "car"]


def test_bad_tables() -> None:
    with pytest.raises(ValueError, match="2 boxes has 1 rows of labels"):
        Boxes3D.create(np.zeros((2, 3)), np.ones((2, 3)), [0, 0], ["car"])
    with pytest.raises(ValueError, match="box 0 has the size"):
        one(size=(4, 0, 1))
    with pytest.raises(ValueError, match="box 0 has a centre_m that is not finite"):
        one(centre=(0, np.nan, 0))
    with pytest.raises(ValueError, match="box 0 has a scores that is not finite"):
        one(scores=[np.inf])
