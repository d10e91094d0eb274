"""Overlap of rotated rectangles against hand-computed cases and an independent polygon intersection."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coin3d import native
from coin3d.detectors.nms import rotated_iou, rotated_nms
from coin3d.geometry import Boxes3D

Rectangle = tuple[float, float, float, float, float]


def table(rectangles: list[Rectangle], scores: list[float] | None = None, labels: list[str] | None = None) -> Boxes3D:
    values = np.array(rectangles, dtype=np.float64).reshape(-1, 5)
    flat = np.zeros(len(values))
    size = np.column_stack([values[:, 2:4], flat + 1.5])
    centre = np.column_stack([values[:, :2], flat])
    return Boxes3D.create(centre, size, values[:, 4], labels or ["car"] * len(values), scores=scores)


def iou(a: Rectangle, b: Rectangle) -> float:
    return float(rotated_iou(table([a]), table([b]))[0, 0])


def overlap_area(a: Boxes3D, b: Boxes3D) -> float:
    """Area of the intersection: the hull of all corners of one in the other and of all crossings of edges."""
    p, q = a.corners()[0, :4, :2], b.corners()[0, :4, :2]
    points = [*p[_inside(p, b)], *q[_inside(q, a)]]
    for i in range(4):
        for j in range(4):
            r, s = p[(i + 1) % 4] - p[i], q[(j + 1) % 4] - q[j]
            det = r[0] * s[1] - r[1] * s[0]
            if abs(det) < 1e-12:
                continue
            d = q[j] - p[i]
            t, u = (d[0] * s[1] - d[1] * s[0]) / det, (d[0] * r[1] - d[1] * r[0]) / det
            if -1e-12 <= t <= 1 + 1e-12 and -1e-12 <= u <= 1 + 1e-12:
                points.append(p[i] + t * r)
    if len(points) < 3:
        return 0.0
    hull = np.array(points) - np.mean(points, axis=0)
    x, y = hull[np.argsort(np.arctan2(hull[:, 1], hull[:, 0]))].T
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)


def _inside(points: np.ndarray, box: Boxes3D) -> np.ndarray:
    offset = points - box.centre_m[0, :2]
    c, s = np.cos(box.yaw_rad[0]), np.sin(box.yaw_rad[0])
    local = np.abs(offset @ np.array([[c, -s], [s, c]]))
    return (local <= box.size_m[0, :2] / 2 + 1e-12).all(1)


def test_by_hand() -> None:
    box = (3.0, -2.0, 4.0, 2.0, 0.0)
    assert iou(box, box) == pytest.approx(1)
    assert iou(box, (5.0, -2.0, 4.0, 2.0, 0.0)) == pytest.approx(1 / 3)  # half of each is shared: 4 / (8 + 8 - 4)
    assert iou(box, (3.0, -2.0, 4.0, 2.0, np.pi)) == pytest.approx(1)
    assert iou(box, (3.0, -2.0, 2.0, 4.0, np.pi / 2)) == pytest.approx(1)  # length and width exchanged, turned back
    assert iou(box, (3.0, -2.0, 4.0, 2.0, np.pi / 2)) == pytest.approx(4 / 12)  # a cross
    assert iou(box, (3.0, -2.0, 2.0, 1.0, 0.0)) == pytest.approx(2 / 8)  # one inside the other
    # a unit square and the same turned by 45 degrees share a regular octagon of area 2 (sqrt 2 - 1)
    octagon = 2 * (np.sqrt(2) - 1)
    assert iou((0, 0, 1, 1, 0), (0, 0, 1, 1, np.pi / 4)) == pytest.approx(octagon / (2 - octagon))


def test_neighbours_that_only_touch() -> None:
    assert iou((0, 0, 4, 2, 0), (4, 0, 4, 2, 0)) == pytest.approx(0, abs=1e-12)
    assert iou((0, 0, 2, 2, 0), (2, 2, 2, 2, 0)) == pytest.approx(0, abs=1e-12)
    assert iou((0, 0, 4, 2, 0), (40, 0, 4, 2, 0)) == 0


side, place, angle = st.floats(0.2, 8), st.floats(-4, 4), st.floats(-7, 7)
rectangle = st.tuples(place, place, side, side, angle)


@given(rectangle, rectangle)
def test_equals_an_independent_intersection(a: Rectangle, b: Rectangle) -> None:
    common = overlap_area(table([a]), table([b]))
    expected = common / (a[2] * a[3] + b[2] * b[3] - common)
    assert iou(a, b) == pytest.approx(expected, abs=1e-9)
    assert iou(b, a) == pytest.approx(iou(a, b), abs=1e-9)


@given(rectangle, rectangle, st.floats(-1e5, 1e5), st.floats(-1e5, 1e5), angle)
def test_moving_both_changes_nothing(a: Rectangle, b: Rectangle, dx: float, dy: float, turn: float) -> None:
    c, s = np.cos(turn), np.sin(turn)

    def moved(r: Rectangle) -> Rectangle:
        return (c * r[0] - s * r[1] + dx, s * r[0] + c * r[1] + dy, r[2], r[3], r[4] + turn)

    assert iou(moved(a), moved(b)) == pytest.approx(iou(a, b), abs=1e-8)


def test_agrees_with_points_thrown_at_random() -> None:
    a, b = (0.3, -0.4, 4.2, 1.9, 0.5), (1.1, 0.2, 4.6, 2.1, -0.4)
    points = np.random.default_rng(0).uniform(-5, 5, (400_000, 3)) * (1, 1, 0)
    in_a, in_b = table([a]).contains(points)[0], table([b]).contains(points)[0]
    assert iou(a, b) == pytest.approx((in_a & in_b).sum() / (in_a | in_b).sum(), abs=5e-3)


def test_boxes_without_area_overlap_nothing() -> None:
    flat = np.array([[0.0, 0, 0, 0, 0.3], [0, 0, 4, 0, 0], [0, 0, 4, 2, 0]])
    out = np.full((3, 3), np.nan)
    native.rotated_iou(flat, flat, out)
    np.testing.assert_allclose(out, [[0, 0, 0], [0, 0, 0], [0, 0, 1]], atol=1e-12)


def test_nothing_at_all() -> None:
    assert rotated_iou(Boxes3D.empty(), table([(0, 0, 1, 1, 0)])).shape == (0, 1)
    assert len(rotated_nms(Boxes3D.empty(), 0.2)) == 0


def test_the_better_box_stays() -> None:
    car, shifted, far, inside = (0, 0, 4, 2, 0), (1, 0, 4, 2, 0), (10, 0, 4, 2, 0), (0, 0, 2, 1, 0.1)
    boxes = table([car, shifted, far, inside], [0.5, 0.9, 0.3, 0.4])
    assert rotated_nms(boxes, 0.2).tolist() == [1, 2]
    # 6 / 10 is shared by the first two: at the threshold the weaker goes, above it stays
    assert rotated_nms(boxes[:2], 0.6 - 1e-9).tolist() == [1]
    assert rotated_nms(boxes[:2], 0.6 + 1e-9).tolist() == [1, 0]


def test_a_suppressed_box_suppresses_nothing() -> None:
    chain = table([(0, 0, 4, 2, 0), (2, 0, 4, 2, 0), (4, 0, 4, 2, 0)], [0.9, 0.8, 0.7])
    assert rotated_nms(chain, 0.3).tolist() == [0, 2]


def test_classes_compete_and_ties_keep_their_order() -> None:
    boxes = table([(0, 0, 4, 2, 0), (0, 0, 4, 2, 0)], [0.5, 0.5], ["car", "pedestrian"])
    assert rotated_nms(boxes, 0.2).tolist() == [0]


def test_missing_box_is_refused() -> None:
    with pytest.raises(ValueError, match="missing box"):
        native.rotated_nms(np.zeros((2, 5)), np.array([0, 2]), 0.2)
    with pytest.raises(ValueError, match="five columns"):
        native.rotated_nms(np.zeros((2, 4)), np.array([0]), 0.2)
