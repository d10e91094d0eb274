"""Pose algebra: hand-computed turns and the group laws on random poses."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coin3d.geometry import Pose, camera_pose
from coin3d.geometry.pose import headings

angle = st.floats(-np.pi, np.pi)
metres = st.tuples(*[st.floats(-50, 50)] * 3)
poses = st.builds(Pose.from_euler, angle, st.floats(-1.5, 1.5), angle, metres)


def test_yaw_turns_left() -> None:
    turned = Pose.from_euler(np.pi / 2, 0, 0, (10, 0, 0))
    np.testing.assert_allclose(turned.apply(np.array([[1.0, 0, 0], [0, 1, 2]])), [[10, 1, 0], [9, 0, 2]], atol=1e-12)
    assert turned.yaw_rad == pytest.approx(np.pi / 2)


def test_positive_pitch_looks_down_and_positive_roll_tilts_right() -> None:
    np.testing.assert_allclose(
        Pose.from_euler(0, 0.1, 0, (0, 0, 0)).rotate(np.array([1.0, 0, 0])), [np.cos(0.1), 0, -np.sin(0.1)], atol=1e-12
    )
    # tilted to the right, the left side (y) goes up
    assert Pose.from_euler(0, 0, 0.1, (0, 0, 0)).rotate(np.array([0.0, 1, 0]))[2] == pytest.approx(np.sin(0.1))


@pytest.mark.parametrize(("yaw_deg", "looks"), [(0, (1, 0, 0)), (90, (0, 1, 0)), (180, (-1, 0, 0)), (-90, (0, -1, 0))])
def test_camera_axes(yaw_deg: float, looks: tuple[float, float, float]) -> None:
    pose = camera_pose((1, 2, 3), np.deg2rad(yaw_deg))
    np.testing.assert_allclose(pose.rotation[:, 2], looks, atol=1e-12)  # z forward
    np.testing.assert_allclose(pose.rotation[:, 1], (0, 0, -1), atol=1e-12)  # y down
    np.testing.assert_allclose(pose.rotation[:, 0], np.cross((0, 0, -1), looks), atol=1e-12)  # x right = down x forward
    np.testing.assert_array_equal(pose.translation, (1, 2, 3))


@given(poses, poses, poses)
def test_group_laws(a: Pose, b: Pose, c: Pose) -> None:
    assert (a @ a.inverse()).allclose(Pose.identity())
    assert ((a @ b) @ c).allclose(a @ (b @ c))
    assert (a @ b).inverse().allclose(b.inverse() @ a.inverse())
    points = np.array([[1.0, -2, 3], [0, 0, 0]])
    np.testing.assert_allclose((a @ b).apply(points), a.apply(b.apply(points)), atol=1e-9)
    np.testing.assert_allclose((a @ b).matrix, a.matrix @ b.matrix, atol=1e-9)


@given(poses)
def test_matrix_and_quaternion_round_trip(pose: Pose) -> None:
    assert Pose.from_matrix(pose.matrix).allclose(pose)
    assert Pose.from_matrix(pose.matrix[:3]).allclose(pose)
    assert Pose.from_quaternion(pose.quaternion, pose.translation).allclose(pose)
    assert pose.quaternion[0] >= 0
    assert pickle.loads(pickle.dumps(pose)).allclose(pose, atol=0)


def test_quaternion_order_is_wxyz() -> None:
    half = np.sqrt(0.5)
    quarter_left = Pose.from_quaternion((half, 0, 0, half), (0, 0, 0))
    assert quarter_left.yaw_rad == pytest.approx(np.pi / 2)


def test_rounding_is_repaired_but_nothing_else() -> None:
    rounded = np.round(Pose.from_euler(0.3, 0.2, 0.1, (0, 0, 0)).rotation, 4)
    repaired = Pose(rounded, np.zeros(3)).rotation
    np.testing.assert_allclose(repaired @ repaired.T, np.eye(3), atol=1e-14)


def test_poses_cannot_be_written_into() -> None:
    pose = Pose.identity()
    for array in (pose.rotation, pose.translation, pose.matrix):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 7.0


_MIRROR = np.diag([1.0, 1.0, -1.0])


@pytest.mark.parametrize(
    ("rotation", "translation", "message"),
    [
        (np.eye(4), np.zeros(3), r"\(3, 3\) rotation"),
        (np.eye(3), np.zeros(4), r"\(3,\) translation"),
        (np.eye(3) * np.nan, np.zeros(3), "not finite"),
        (np.eye(3), np.array([0, np.inf, 0]), "not finite"),
        (np.eye(3) * 1.01, np.zeros(3), "not a rotation matrix"),
        (_MIRROR, np.zeros(3), "mirrored"),
    ],
)
def test_bad_poses(rotation: np.ndarray, translation: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Pose(rotation, translation)


def test_bad_matrices_and_quaternions() -> None:
    with pytest.raises(ValueError, match=r"\(4, 4\) or \(3, 4\)"):
        Pose.from_matrix(np.eye(3))
    with pytest.raises(ValueError, match="transposed"):
        Pose.from_matrix(Pose.from_euler(0, 0, 0, (1, 2, 3)).matrix.T)
    with pytest.raises(ValueError, match="length 1"):
        Pose.from_quaternion((1, 1, 0, 0), (0, 0, 0))


@given(st.lists(poses, min_size=1, max_size=5), st.floats(0.995, 1.005))
def test_headings_of_many_are_those_of_each(many: list[Pose], length: float) -> None:
    quaternions = length * np.stack([pose.quaternion for pose in many])
    expected = [Pose.from_quaternion(q, (0, 0, 0)).yaw_rad for q in quaternions]
    turned = np.stack([np.cos(expected), np.sin(expected)])
    found = headings(quaternions)
    np.testing.assert_allclose([np.cos(found), np.sin(found)], turned, atol=1e-9)


def test_headings_want_quaternions_of_length_one() -> None:
    for wrong in ([2.0, 0, 0, 0], [np.nan, 0, 0, 1], [0.0, 0, 0, 0]):
        with pytest.raises(ValueError, match="length 1"):
            headings(np.array([[1.0, 0, 0, 0], wrong]))
