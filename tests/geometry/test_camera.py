"""Cameras: projection by hand, its inverse on random cameras, field of view, and what is rejected."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coin3d.geometry import MIN_DEPTH_M, Camera, Pose, camera_pose

K = np.array([[100.0, 0, 60], [0, 120, 40], [0, 0, 1]])
FORWARD = Camera(K, 120, 80, camera_pose((1.0, 0.0, 1.5)))

unit = st.floats(-1, 1)


@st.composite
def cameras(draw: st.DrawFn) -> Camera:
    focal = draw(st.floats(100, 2000))
    linear = np.diag([focal, focal * draw(st.floats(0.5, 2))])
    turn = draw(unit)
    linear = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ linear
    if draw(st.booleans()):
        linear[0] *= -1
    intrinsics = np.eye(3)
    intrinsics[:2, :2], intrinsics[:2, 2] = linear, (300 + 100 * draw(unit), 200 + 100 * draw(unit))
    pose = camera_pose((5 * draw(unit), 5 * draw(unit), 5 * draw(unit)), 3 * draw(unit), draw(unit), draw(unit))
    return Camera(intrinsics, 640, 400, pose)


def test_projection_by_hand() -> None:
    # 10 m ahead of the camera, 1 m to the left, 0.5 m below it
    pixels, depth = FORWARD.project(np.array([11.0, 1.0, 1.0]))
    np.testing.assert_allclose(pixels, [60 - 10, 40 + 6])
    assert depth == pytest.approx(10)


def test_points_behind_have_no_pixel() -> None:
    pixels, depth = FORWARD.project(np.array([[0.0, 0, 1.5], [1.0, 5, 1.5], [3.0, 0, 1.5]]))
    assert np.isnan(pixels[:2]).all() and np.isfinite(pixels[2]).all()
    np.testing.assert_allclose(depth, [-1, 0, 2], atol=1e-12)


@given(cameras(), st.floats(0, 640), st.floats(0, 400), st.floats(0.5, 200))
def test_unprojecting_and_projecting_round_trip(camera: Camera, u: float, v: float, depth_m: float) -> None:
    point = camera.ego_from_cam.translation + depth_m * camera.rays_ego(np.array([u, v]))
    pixel, depth = camera.project(point)
    np.testing.assert_allclose(pixel, [u, v], atol=1e-6)
    assert depth == pytest.approx(depth_m, rel=1e-9)


@given(cameras())
def test_projection_is_the_matrix_product(camera: Camera) -> None:
    points = camera.ego_from_cam.apply(np.array([[0.3, -0.2, 4.0], [5.0, 1.0, 9.0]]))
    cam_from_ego = camera.ego_from_cam.inverse().matrix
    homogeneous = np.concatenate([points, np.ones((2, 1))], axis=1) @ (camera.K @ cam_from_ego[:3]).T
    pixels, depth = camera.project(points)
    np.testing.assert_allclose(pixels, homogeneous[:, :2] / homogeneous[:, 2:], atol=1e-7)
    np.testing.assert_allclose(depth, homogeneous[:, 2])


def test_pixel_grid_holds_centres_and_any_leading_shape_works() -> None:
    grid = FORWARD.pixel_grid()
    assert grid.shape == (80, 120, 2)
    assert grid[0, 0].tolist() == [0.5, 0.5] and grid[79, 119].tolist() == [119.5, 79.5]
    rays = FORWARD.rays_cam(grid)
    assert rays.shape == (80, 120, 3) and (rays[..., 2] == 1).all()
    pixels, depth = FORWARD.project(FORWARD.ego_from_cam.apply(7 * rays))
    np.testing.assert_allclose(pixels, grid, atol=1e-9)
    np.testing.assert_allclose(depth, 7)


def test_sees() -> None:
    ahead = np.array([[11.0, 0, 1.5], [11.0, 6.1, 1.5], [11.0, 5.9, 1.5], [1 + 0.9 * MIN_DEPTH_M, 0, 1.5], [-9.0, 0, 1.5]])
    assert FORWARD.sees(ahead).tolist() == [True, False, True, False, False]


def test_field_of_view_uses_the_principal_point() -> None:
    camera = Camera(np.array([[2050.0, 0, 960], [0, 2050, 246], [0, 0, 1]]), 1920, 886, Pose.identity())
    assert np.rad2deg(camera.fov_horizontal_rad) == pytest.approx(2 * np.rad2deg(np.arctan(960 / 2050)))
    assert np.rad2deg(camera.fov_vertical_rad) == pytest.approx(2 * np.rad2deg(np.arctan(640 / 2050)))


@given(cameras(), unit)
def test_focal_length_ignores_rotation_and_flip_and_follows_zoom(camera: Camera, turn: float) -> None:
    c, s = np.cos(turn), np.sin(turn)
    turned = camera.transformed(np.array([[c, -s, 3], [s, c, 5], [0, 0, 1]]), 640, 400)
    mirrored = camera.transformed(np.diag([-1.0, 1, 1]), 640, 400)
    zoomed = camera.transformed(np.diag([1.5, 1.5, 1]), 960, 600)
    assert turned.focal_px == pytest.approx(camera.focal_px)
    assert mirrored.focal_px == pytest.approx(camera.focal_px)
    assert zoomed.focal_px == pytest.approx(1.5 * camera.focal_px)


def test_moved_and_transformed_keep_the_rest() -> None:
    there = camera_pose((0, 0, 2), 1.0)
    assert FORWARD.moved(there).ego_from_cam is there and FORWARD.moved(there).K is not None
    half = FORWARD.transformed(np.diag([0.5, 0.5, 1]), 60, 40)
    assert half.ego_from_cam is FORWARD.ego_from_cam and (half.width_px, half.height_px) == (60, 40)
    assert FORWARD.moved(there).yaw_rad == pytest.approx(1.0) and FORWARD.height_m == 1.5


@pytest.mark.parametrize(
    ("matrix", "size", "message"),
    [
        (np.eye(4), (10, 10), r"\(3, 3\)"),
        (K * np.nan, (10, 10), "not finite"),
        (K.T, (10, 10), "transposed"),
        (np.diag([0.0, 100, 1]), (10, 10), "singular"),
        (np.array([[1.0, 1, 0], [1, 1, 0], [0, 0, 1]]), (10, 10), "singular"),
        (K, (0, 10), "0 x 10"),
        (K, (10, -3), "10 x -3"),
    ],
)
def test_bad_cameras(matrix: np.ndarray, size: tuple[int, int], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Camera(matrix, *size, Pose.identity())
