"""Boxes, points and the ground in a camera's image."""

from __future__ import annotations

import numpy as np
import pytest

from coin3d.drawing.colours import PREDICTION, colour_map
from coin3d.drawing.pictures import draw_boxes, draw_ground, draw_points, project_line
from coin3d.geometry import Boxes3D, Camera, GroundPlane, camera_pose

K = np.array([[300.0, 0, 200], [0, 300, 150], [0, 0, 1]])
CAMERA = Camera(K, 400, 300, camera_pose([0, 0, 1.5]))
BLANK = np.zeros((300, 400, 3), dtype=np.uint8)


def _box(x: float, y: float, length: float = 4.0) -> Boxes3D:
    return Boxes3D.create([[x, y, 0.8]], [[length, 1.8, 1.6]], [0.0], ["car"])


def _changed(image: np.ndarray) -> np.ndarray:
    return np.argwhere(image.any(-1))


def test_a_box_ahead_fills_its_projected_outline() -> None:
    box = _box(12.0, 2.0)
    pixels, _ = CAMERA.project(box.corners()[0])
    rows_columns = _changed(draw_boxes(BLANK, CAMERA, box))
    np.testing.assert_allclose(rows_columns.min(0)[::-1], pixels.min(0), atol=3)
    np.testing.assert_allclose(rows_columns.max(0)[::-1], pixels.max(0), atol=3)


def test_the_front_face_is_marked() -> None:
    # the far face is the front of a box that drives away, the near face that of one that comes towards us
    away = draw_boxes(BLANK, CAMERA, _box(12.0, 0.0))
    towards = draw_boxes(BLANK, CAMERA, Boxes3D.create([[12.0, 0, 0.8]], [[4.0, 1.8, 1.6]], [np.pi], ["car"]))
    near_centre, _ = CAMERA.project(np.array([10.0, 0.35, 0.8]))
    column, row = near_centre.astype(int)
    assert towards[row, column].any()
    assert len(_changed(towards)) > len(_changed(away))


def test_boxes_behind_draw_nothing() -> None:
    assert not draw_boxes(BLANK, CAMERA, _box(-8.0, 0.0)).any()


def test_a_box_beside_the_camera_stays_on_its_side() -> None:
    # from 10 m behind to 10 m ahead, on the left: naive projection draws its rear end mirrored to the right
    columns = _changed(draw_boxes(BLANK, CAMERA, _box(0.0, 3.0, length=20.0)))[:, 1]
    assert len(columns)
    assert columns.max() < 200


def test_a_box_around_the_camera_does_not_fail() -> None:
    assert draw_boxes(BLANK, CAMERA, _box(0.0, 0.0, length=6.0)).shape == BLANK.shape


def test_lines_are_cut_at_the_image_plane() -> None:
    assert project_line(CAMERA, np.array([-5.0, 1, 1]), np.array([-1.0, 1, 1])) == []
    (line,) = project_line(CAMERA, np.array([-5.0, 1.0, 1.5]), np.array([10.0, 1.0, 1.5]))
    np.testing.assert_allclose(line[-1], [200 - 300 / 10, 150], atol=1e-9)
    np.testing.assert_allclose(line[0], [200 - 300 / 0.2, 150], atol=1e-6)


def test_one_colour_and_scores() -> None:
    boxes = _box(12.0, 0.0)
    plain = draw_boxes(BLANK, CAMERA, boxes, PREDICTION)
    assert (plain == PREDICTION).all(-1).any()
    assert _changed(draw_boxes(BLANK, CAMERA, boxes, PREDICTION, with_scores=True))[:, 0].min() < _changed(plain)[:, 0].min()
    assert not BLANK.any()


def test_near_points_cover_far_ones() -> None:
    near, far = np.array([5.0, 0.5, 1.5]), np.array([40.0, 4.0, 1.5])
    behind = np.array([-5.0, 0.5, 1.5])
    both = draw_points(BLANK, CAMERA, np.stack([near, far, behind]))
    only_near = draw_points(BLANK, CAMERA, near[None])
    column, row = np.floor(CAMERA.project(near)[0]).astype(int)
    np.testing.assert_array_equal(both[row, column], only_near[row, column])
    assert both[row, column, 0] > both[row, column, 2]  # red, not blue
    assert not draw_points(BLANK, CAMERA, behind[None]).any()


def test_ground_rings_lie_where_the_ground_is() -> None:
    image = draw_ground(BLANK, CAMERA, GroundPlane())
    assert image[150 + round(300 * 1.5 / 10), 205:215].any()
    assert not image[:148].any()
    lower = draw_ground(BLANK, CAMERA, GroundPlane(offset_m=0.5))
    assert lower[150 + round(300 * 2.0 / 10), 205:215].any()


def test_image_and_camera_must_belong_together() -> None:
    with pytest.raises(ValueError, match="200 x 150 pixels with a camera of 400 x 300"):
        draw_points(BLANK[::2, ::2], CAMERA, np.zeros((0, 3)))


def test_colour_map() -> None:
    colours = colour_map(np.array([[0.0, 1.0], [np.nan, 9.0]]), 0.0, 1.0, "gray", invalid=(1, 2, 3))
    assert colours.tolist() == [[[0, 0, 0], [255, 255, 255]], [[1, 2, 3], [255, 255, 255]]]
    assert colour_map(np.full((2, 2), np.nan)).tolist() == [[[0, 0, 0]] * 2] * 2
    assert colour_map(np.array([3.0, 3.0])).shape == (2, 3)
