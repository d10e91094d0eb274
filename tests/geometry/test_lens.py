"""Lenses: values by hand, OpenCV's own projection, the inverse, and where a model stops being one."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coin3d.geometry import BrownConrady, Camera, Fisheye, Lens, Pinhole, Pose, camera_pose

# a front camera of Waymo has coefficients of this size
WAYMO = BrownConrady(0.04, -0.33, 0.0017, -0.0004, 0.02)
RATIONAL = BrownConrady(2.1, 0.4, -0.0003, 0.0002, 0.01, 2.5, 1.1, 0.07)
FISHEYE = Fisheye(-0.012, -0.011, 0.006, -0.0016)

coefficient = st.floats(-0.5, 0.5)
small = st.floats(-0.01, 0.01)
ordinary = st.tuples(coefficient, coefficient, small, small, coefficient)
rational = st.tuples(coefficient, coefficient, small, small, coefficient, coefficient, coefficient, coefficient)
fisheye = st.tuples(*[st.floats(-0.1, 0.1)] * 4)
directions = st.floats(-np.pi, np.pi)
shares = st.floats(0, 0.98)


def test_brown_conrady_by_hand() -> None:
    # x = 0.5, y = -0.25, r^2 = 0.3125: radial factor 1 + 0.1 * 0.3125 + 0.2 * 0.09765625 + 0.3 * 0.030517578125
    factor = 1 + 0.03125 + 0.01953125 + 0.0091552734375
    x = 0.5 * factor + 2 * 0.01 * 0.5 * -0.25 + 0.02 * (0.3125 + 2 * 0.25)
    y = -0.25 * factor + 0.01 * (0.3125 + 2 * 0.0625) + 2 * 0.02 * 0.5 * -0.25
    lens = BrownConrady(0.1, 0.2, 0.01, 0.02, 0.3)
    np.testing.assert_allclose(lens.plane_from_ray(np.array([1.0, -0.5, 2.0])), [x, y], rtol=1e-15)
    rational = BrownConrady(0.1, 0.2, 0, 0, 0.3, 0.1, 0.2, 0.3)  # numerator and denominator cancel
    np.testing.assert_allclose(rational.plane_from_ray(np.array([1.0, -0.5, 2.0])), [0.5, -0.25], rtol=1e-15)


def test_fisheye_by_hand() -> None:
    # a ray 45 degrees to the right: theta = pi / 4, and the equidistant lens puts it at theta
    np.testing.assert_allclose(Fisheye(0, 0, 0, 0).plane_from_ray(np.array([3.0, 0, 3.0])), [np.pi / 4, 0], rtol=1e-15)
    theta = np.pi / 4
    bent = theta * (1 + 0.1 * theta**2 - 0.02 * theta**4 + 0.003 * theta**6 - 0.0004 * theta**8)
    lens = Fisheye(0.1, -0.02, 0.003, -0.0004)
    np.testing.assert_allclose(lens.plane_from_ray(np.array([0.0, -2.0, 2.0])), [0, -bent], atol=1e-16)
    # 120 degrees to the left: behind the camera, still on the image of a wide lens
    back = np.array([-np.sin(2 * np.pi / 3), 0, np.cos(2 * np.pi / 3)])
    np.testing.assert_allclose(Fisheye(0, 0, 0, 0).plane_from_ray(back), [-2 * np.pi / 3, 0], atol=1e-15)
    np.testing.assert_allclose(Fisheye(0, 0, 0, 0).ray_from_plane(np.array([-2 * np.pi / 3, 0])), back, atol=1e-12)


def test_the_optical_axis_is_the_principal_point() -> None:
    for lens in (WAYMO, RATIONAL, FISHEYE, Fisheye(0, 0, 0, 0)):
        np.testing.assert_array_equal(lens.plane_from_ray(np.array([0.0, 0, 7])), [0, 0])
        np.testing.assert_array_equal(lens.ray_from_plane(np.zeros(2)), [0, 0, 1])


@pytest.mark.parametrize("lens", [WAYMO, RATIONAL, BrownConrady(-0.3, 0.1, 0.001, -0.002)])
def test_equal_to_opencv(lens: BrownConrady) -> None:
    points = np.random.default_rng(0).uniform((-3, -2, 4), (3, 2, 9), (500, 3))
    K = np.array([[1100.0, 0, 955.5], [0, 1090, 610.25], [0, 0, 1]])
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, np.array(lens.coefficients))[0][:, 0]
    camera = Camera(K, 1920, 1280, Pose.identity(), lens)
    np.testing.assert_allclose(camera.project(points)[0], expected, atol=1e-9)


def test_fisheye_equal_to_opencv() -> None:
    points = np.random.default_rng(0).uniform((-9, -9, 1), (9, 9, 6), (500, 3))
    K = np.array([[380.0, 0, 640.5], [0, 381, 480.25], [0, 0, 1]])
    expected = cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), K, np.array(FISHEYE.coefficients))[0][:, 0]
    camera = Camera(K, 1280, 960, Pose.identity(), FISHEYE)
    np.testing.assert_allclose(camera.project(points)[0], expected, atol=1e-9)


@given(ordinary | rational, shares, directions)
def test_brown_conrady_and_its_inverse(coefficients: tuple[float, ...], share: float, direction: float) -> None:
    lens = BrownConrady(*coefficients)
    r = np.tan(share * np.arctan(lens.radius))
    ray = np.array([r * np.cos(direction), r * np.sin(direction), 1.0])
    plane = lens.plane_from_ray(ray)
    assert np.isfinite(plane).all()
    again = lens.ray_from_plane(plane)
    # angles, because rays near the image plane have coordinates of any size
    np.testing.assert_allclose(again / np.linalg.norm(again), ray / np.linalg.norm(ray), atol=1e-9)


@given(fisheye, shares, directions)
def test_fisheye_and_its_inverse(coefficients: tuple[float, ...], share: float, direction: float) -> None:
    lens = Fisheye(*coefficients)
    theta = share * lens.angle_rad
    ray = np.array([np.sin(theta) * np.cos(direction), np.sin(theta) * np.sin(direction), np.cos(theta)])
    np.testing.assert_allclose(lens.ray_from_plane(lens.plane_from_ray(ray)), ray, atol=1e-9)


@given(ordinary | rational, st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=2, max_size=2, unique=True))
def test_no_two_rays_share_an_image_point(coefficients: tuple[float, ...], places: list[tuple[float, float]]) -> None:
    """The derivative is positive definite on the disc, hence (F(a) - F(b)) . (a - b) > 0 for any two of its points."""
    lens = BrownConrady(*coefficients)
    a, b = (min(lens.radius, 2.0) * 0.7 * np.array(place) for place in places)
    if np.linalg.norm(a - b) < 1e-6:
        return
    image_a, image_b = lens.plane_from_ray(np.array([[*a, 1.0], [*b, 1.0]]))
    assert (image_a - image_b) @ (a - b) > 0


def test_a_barrel_lens_is_not_believed_where_it_folds_back() -> None:
    # r (1 - 0.3 r^2) rises until r = sqrt(1 / 0.9) and comes back to the centre at sqrt(1 / 0.3): 61 degrees off the axis
    lens = BrownConrady(-0.3, 0, 0, 0)
    assert lens.radius == pytest.approx(np.sqrt(1 / 0.9), abs=1e-12)
    inside, outside, folded = lens.plane_from_ray(np.array([[1.05, 0, 1], [1.06, 0, 1], [np.sqrt(1 / 0.3), 0, 1]]))
    assert np.isfinite(inside).all() and np.isnan(outside).all() and np.isnan(folded).all()
    # nothing maps beyond the crest, 2 / 3 of its radius
    crest = 2 / 3 * lens.radius
    np.testing.assert_allclose(lens.ray_from_plane(np.array([crest - 1e-6, 0.0]))[0], lens.radius, atol=2e-3)
    assert np.isnan(lens.ray_from_plane(np.array([crest + 1e-6, 0.0]))).all()
    camera = Camera(np.array([[800.0, 0, 640], [0, 800, 360], [0, 0, 1]]), 1280, 720, camera_pose((0, 0, 1.5)), lens)
    assert camera.sees(np.array([[10.0, 5, 1.5], [10.0, 18.26, 1.5]])).tolist() == [True, False]


def test_tangential_distortion_limits_the_field_too() -> None:
    # y = 0: x + 3 p2 x^2 turns at x = -1 / (6 p2)
    assert BrownConrady(0, 0, 0, 0.01).radius == pytest.approx(1 / 0.06, abs=1e-9)
    assert BrownConrady(0, 0, -0.01, 0).radius == pytest.approx(1 / 0.06, abs=1e-9)
    folded = BrownConrady(0, 0, 0, 0.01).plane_from_ray(np.array([-33.0, 0, 1]))  # the formula says -0.33
    assert np.isnan(folded).all()


def test_the_pole_of_a_rational_lens_limits_the_field() -> None:
    assert BrownConrady(0, 0, 0, 0, 0, -0.25).radius == pytest.approx(2, abs=1e-9)


def test_a_fisheye_ends_where_its_polynomial_stops_rising() -> None:
    lens = Fisheye(-0.1, 0, 0, 0)
    assert lens.angle_rad == pytest.approx(np.sqrt(1 / 0.3), abs=1e-12)
    angles = np.array([0.99, 1.01]) * lens.angle_rad
    near, far = lens.plane_from_ray(np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=-1))
    assert np.isfinite(near).all() and np.isnan(far).all()
    assert np.isnan(lens.ray_from_plane(np.array([2 / 3 * lens.angle_rad + 1e-6, 0]))).all()
    assert Fisheye(0, 0, 0, 0).angle_rad == np.pi


def test_rays_behind_an_ordinary_lens_have_no_image() -> None:
    assert np.isnan(WAYMO.plane_from_ray(np.array([[0.1, 0, -1], [0.1, 0, 0], [np.nan, 0, 1]]))).all()
    assert np.isnan(WAYMO.ray_from_plane(np.array([np.nan, 0]))).all()
    assert np.isnan(FISHEYE.ray_from_plane(np.array([np.nan, 0]))).all()


def test_a_camera_with_a_lens_and_its_rays() -> None:
    K = np.array([[600.0, 0, 320], [0, 610, 200], [0, 0, 1]])
    for lens in (WAYMO, RATIONAL, FISHEYE):
        camera = Camera(K, 640, 400, camera_pose((1.2, 0.3, 1.6), 0.4, 0.1, -0.05), lens)
        pixels = camera.pixel_grid()[::40, ::40]
        points = camera.ego_from_cam.translation + 12 * camera.rays_ego(pixels)
        np.testing.assert_allclose(camera.project(points)[0], pixels, atol=1e-9)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_coefficients_that_are_not_finite_are_refused(bad: float) -> None:
    with pytest.raises(ValueError, match=r"Brown-Conrady lens.*not finite .p2, k6"):
        BrownConrady(0, 0, 0, bad, k6=bad)
    with pytest.raises(ValueError, match=r"fisheye lens.*not finite .k3"):
        Fisheye(0, 0, bad, 0)


@pytest.mark.parametrize("size", [1e30, 1e300])
def test_coefficients_that_leave_no_field_are_refused(size: float) -> None:
    with pytest.raises(ValueError, match=r"Brown-Conrady lens .* folds back .* off its axis: check the order"):
        BrownConrady(-size, size, size, size, -size, size, size, -size)
    with pytest.raises(ValueError, match=r"fisheye lens .* folds back .* off its axis: check the order"):
        Fisheye(-size, size, -size, size)


@pytest.mark.parametrize("size", [1e-300, 1e-30])
def test_coefficients_too_small_to_matter(size: float) -> None:
    for lens, expected in ((BrownConrady(*[size, -size] * 4), 0.75), (Fisheye(size, -size, size, -size), np.arctan(0.75))):
        plane = lens.plane_from_ray(np.array([[0.0, 0, 1], [0.3, 0, 0.4]]))
        np.testing.assert_allclose(plane, [[0, 0], [expected, 0]], atol=1e-15)
        assert np.isfinite(lens.ray_from_plane(plane)).all()


def test_lenses_are_values() -> None:
    assert BrownConrady(1, 2, 3, 4) == BrownConrady(1.0, 2.0, 3.0, 4.0, 0.0)
    assert BrownConrady(1, 2, 3, 4) != BrownConrady(1, 2, 3, 4, 5) and Fisheye(1, 2, 3, 4) != BrownConrady(1, 2, 3, 4)
    assert len({Fisheye(0, 0, 0, 0), Fisheye(0, 0, 0, 0), Fisheye(0, 0, 0, 0.1)}) == 2
    assert BrownConrady(1, 2, 3, 4, 5).coefficients == (1, 2, 3, 4, 5)
    assert RATIONAL.coefficients == (2.1, 0.4, -0.0003, 0.0002, 0.01, 2.5, 1.1, 0.07)
    for lens in (Pinhole(), WAYMO, FISHEYE):
        assert isinstance(lens, Lens)
