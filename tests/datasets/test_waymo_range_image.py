"""Points of range images, computed by hand from the format's description."""

from __future__ import annotations

import math

import numpy as np
import pytest

from coin3d.datasets.waymo_range_image import LaserCalibration, LaserImages, WaymoLidar, laser_points
from coin3d.geometry import Pose

HERE = Pose.identity()
ROOT = math.sqrt(0.5)


def image(height: int, width: int, **ranges: float) -> np.ndarray:
    """``r0c1=10`` puts a range of 10 m in row 0, column 1; nothing came back elsewhere."""
    found = np.full((height, width, 4), -1.0, dtype=np.float32)
    for name, value in ranges.items():
        row, column = name[1:].split("c")
        found[int(row), int(column)] = (value, 0.5, 0, -1)
    return found


def level(mounting: Pose = HERE) -> LaserCalibration:
    return LaserCalibration(mounting, 0.0, 0.0, np.zeros(1))


def test_columns_begin_behind_on_the_left_and_turn_right() -> None:
    # 4 columns: azimuths 135, 45, -45, -135 degrees
    np.testing.assert_allclose(np.rad2deg(level().columns_rad(4)), [135, 45, -45, -135])
    points = laser_points(image(1, 4, r0c0=2, r0c1=2, r0c2=2, r0c3=2), level(), None, HERE)
    np.testing.assert_allclose(points / (2 * ROOT), [(-1, 1, 0), (1, 1, 0), (1, -1, 0), (-1, -1, 0)], atol=1e-9)


def test_the_heading_of_the_mounting_is_taken_off_the_azimuth() -> None:
    # turned left by 90 degrees: column 1 (45 degrees) is -45 degrees in the laser's frame, and 45 again in the vehicle's
    turned = level(Pose.from_euler(math.pi / 2, 0, 0, (1.0, 2.0, 3.0)))
    np.testing.assert_allclose(np.rad2deg(turned.columns_rad(4)), [45, -45, -135, -225])
    (point,) = laser_points(image(1, 4, r0c1=2), turned, None, HERE)
    np.testing.assert_allclose(point, (1 + 2 * ROOT, 2 + 2 * ROOT, 3), atol=1e-9)


def test_the_first_row_looks_highest() -> None:
    listed = LaserCalibration(HERE, 9.0, 9.0, np.array([-0.3, 0.0, 0.1]))
    np.testing.assert_allclose(listed.rows_rad(3), [0.1, 0.0, -0.3])
    points = laser_points(image(3, 4, r0c1=10, r2c1=10), listed, None, HERE)
    np.testing.assert_allclose(points[:, 2], [10 * math.sin(0.1), -10 * math.sin(0.3)], atol=1e-9)
    np.testing.assert_allclose(np.hypot(points[:, 0], points[:, 1]), [10 * math.cos(0.1), 10 * math.cos(0.3)], atol=1e-9)
    # evenly spaced: middles of four steps from -0.4 to 0.4
    even = LaserCalibration(HERE, -0.4, 0.4, np.zeros(0))
    np.testing.assert_allclose(even.rows_rad(4), [0.3, 0.1, -0.1, -0.3])


def test_every_pixel_has_the_vehicle_where_it_was() -> None:
    """The vehicle drives along world y; a pixel is taken 2 m before the frame's instant, the other at it."""
    world_from_ego = Pose.from_euler(math.pi / 2, 0, 0, (1000.0, 50.0, 5.0))
    poses = np.zeros((1, 4, 6), dtype=np.float32)
    poses[0, 1] = (0, 0, math.pi / 2, 1000, 48, 5)
    poses[0, 2] = (0, 0, math.pi / 2, 1000, 50, 5)
    points = laser_points(image(1, 4, r0c1=2, r0c2=2), level(), poses, world_from_ego)
    np.testing.assert_allclose(points, [(2 * ROOT - 2, 2 * ROOT, 0), (2 * ROOT, -2 * ROOT, 0)], atol=1e-6)


def test_roll_pitch_and_yaw_turn_in_this_order() -> None:
    """Rz(90) Ry(90) Rx(90) maps x to -z, y to -x ... : x -> x -> -z -> -z; y -> z -> x -> y; z -> -y -> -y -> x."""
    poses = np.full((1, 4, 6), math.pi / 2)
    poses[..., 3:] = 0
    (point,) = laser_points(image(1, 4, r0c1=2), level(), poses, HERE)
    # the point is (1, 1, 0) * sqrt 2: x goes to -z, y to y
    np.testing.assert_allclose(point, (0, 2 * ROOT, -2 * ROOT), atol=1e-6)


def test_large_coordinates_keep_their_millimetres() -> None:
    far = np.array([-25211.25, 42391.5, -160.625])
    poses = np.zeros((1, 4, 6), dtype=np.float32)
    poses[..., 3:] = far
    (point,) = laser_points(image(1, 4, r0c1=2), level(), poses, Pose(np.eye(3), far))
    np.testing.assert_allclose(point, (2 * ROOT, 2 * ROOT, 0), atol=1e-7)


def test_pixels_without_return_are_no_points() -> None:
    picture = image(1, 4, r0c2=3)
    picture[0, 0, 0], picture[0, 1, 0] = 0.0, np.nan
    assert len(laser_points(picture, level(), None, HERE)) == 1
    assert laser_points(image(1, 4), level(), np.zeros((1, 4, 6)), HERE).shape == (0, 3)
    assert laser_points(np.zeros((1, 0, 4)), level(), None, HERE).shape == (0, 3)


@pytest.mark.parametrize(
    ("picture", "poses", "message"),
    [
        (np.ones((2, 4, 4)), None, "a range image of 2 rows, but a calibration of 1"),
        (np.ones((1, 4, 1)), None, "a range image is rows x columns x"),
        (np.ones((1, 4, 4)), np.ones((1, 5, 6)), "pixel poses of shape .1, 5, 6. for a range image of .1, 4, 4."),
        (np.full((1, 4, 4), np.inf), None, "a range is not finite"),
        (np.ones((1, 4, 4)), np.full((1, 4, 6), np.nan), "the pose of a pixel is not finite"),
    ],
)
def test_images_that_make_no_sense(picture: np.ndarray, poses: np.ndarray | None, message: str) -> None:
    class Source:
        def load(self, second_return: bool) -> dict[str, LaserImages]:
            return {"TOP": LaserImages((picture,), poses)}

    with pytest.raises(ValueError, match=f"frame 7: laser TOP: {message}"):
        WaymoLidar(Source(), {"TOP": level()}, HERE, False, "frame 7").load()
    with pytest.raises(ValueError, match="frame 7: laser TOP has range images but no calibration"):
        WaymoLidar(Source(), {"REAR": level()}, HERE, False, "frame 7").load()


def test_a_calibration_that_is_not_finite() -> None:
    with pytest.raises(ValueError, match="inclination of a laser is not finite"):
        LaserCalibration(HERE, float("nan"), 0.0, np.zeros(0))
