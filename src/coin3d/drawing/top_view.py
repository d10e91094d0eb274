"""The scene from above: ego at the centre, forward up, left to the left."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from coin3d.drawing.colours import BACKGROUND, FAINT, PREDICTION, RGB, TEXT, TRUTH, class_colour, colour_map
from coin3d.drawing.text import put_text, text_size
from coin3d.geometry import Boxes3D, Camera, Rig
from coin3d.geometry.undistort import pinhole_camera

_RING_M = 10.0
_WEDGE_M = 9.0
# drawn larger and shrunk, so that thin lines stay even
_OVERSIZE = 2


@dataclass(frozen=True, eq=False)
class _Canvas:
    """A square picture of the ground and its scale."""

    image: UInt8[np.ndarray, "s s 3"]
    range_m: float

    @property
    def pixels_per_m(self) -> float:
        return float(self.image.shape[0] / (2 * self.range_m))

    def pixels(self, points_ego: Float[np.ndarray, "... d"]) -> Int[np.ndarray, "... 2"]:
        """Whole pixels (right, down) of ego points; ego x is up, ego y is left."""
        right = self.image.shape[0] / 2 - points_ego[..., 1] * self.pixels_per_m
        down = self.image.shape[0] / 2 - points_ego[..., 0] * self.pixels_per_m
        return np.asarray(np.floor(np.stack([right, down], axis=-1)), dtype=np.int32)


def top_view(
    rig: Rig,
    boxes_ego: Boxes3D | None = None,
    predictions_ego: Boxes3D | None = None,
    points_ego: Float[np.ndarray, "n 3"] | None = None,
    range_m: float = 50.0,
    size_px: int = 900,
) -> UInt8[np.ndarray, "s s 3"]:
    """LiDAR points, boxes, the cameras' views as wedges, and range rings every 10 m, in the ego frame.

    A tick from the centre out of the front shows each box's heading. Truth alone is coloured by class; beside
    predictions, truth is red and predictions are green.

    Args:
        rig: cameras; its ground is the zero of the height colours.
        boxes_ego: ground truth.
        predictions_ego: predictions.
        points_ego: LiDAR points.
        range_m: from the centre to each edge.
        size_px: side of the picture.
    """
    side = size_px * _OVERSIZE
    canvas = _Canvas(np.full((side, side, 3), BACKGROUND, dtype=np.uint8), range_m)
    for ring_m in np.arange(_RING_M, range_m + 0.1, _RING_M):
        cv2.circle(canvas.image, (side // 2, side // 2), round(ring_m * canvas.pixels_per_m), (54, 58, 66), 2, cv2.LINE_AA)
    for camera in rig.values():
        _draw_wedge(canvas, camera)
    if points_ego is not None:
        _draw_points(canvas, points_ego, rig.ground.height_m(points_ego))
    if boxes_ego is not None:
        _draw_boxes(canvas, boxes_ego, None if predictions_ego is None else TRUTH)
    if predictions_ego is not None:
        _draw_boxes(canvas, predictions_ego, PREDICTION)
    arrow = np.array([[2.2, 0.0], [-1.0, 0.9], [-0.4, 0.0], [-1.0, -0.9]])
    cv2.fillPoly(canvas.image, [canvas.pixels(arrow)], TEXT, cv2.LINE_AA)
    small = _Canvas(np.asarray(cv2.resize(canvas.image, (size_px, size_px), interpolation=cv2.INTER_AREA)), range_m)
    for ring_m in np.arange(_RING_M, range_m + 0.1, _RING_M):
        left, bottom = small.pixels(np.array([0.0, -ring_m])).tolist()
        put_text(small.image, f"{ring_m:.0f} m", min(left + 3, size_px - 38), bottom - 4, 9, FAINT)
    for name, camera in rig.items():
        _write_name(small, name, camera)
    return small.image


def _draw_wedge(canvas: _Canvas, camera: Camera) -> None:
    straight = pinhole_camera(camera)  # a lens may have no ray at the edge of the image, or one that looks back
    edges = np.array([[0.0, straight.K[1, 2]], [straight.width_px, straight.K[1, 2]]])
    directions = straight.rays_ego(edges)[:, :2]
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    if (lengths < 1e-6).any():
        return  # looks straight up or down: no wedge to draw
    start = camera.ego_from_cam.translation[:2]
    outline = canvas.pixels(np.concatenate([start[None], start + _WEDGE_M * directions / lengths]))
    tinted = canvas.image.copy()
    cv2.fillPoly(tinted, [outline], (70, 90, 130))
    cv2.addWeighted(tinted, 0.35, canvas.image, 0.65, 0.0, dst=canvas.image)
    cv2.polylines(canvas.image, [outline], True, (95, 120, 170), 2, cv2.LINE_AA)


def _write_name(canvas: _Canvas, name: str, camera: Camera) -> None:
    middle = camera.ego_from_cam.translation[:2] + (_WEDGE_M + 1.5) * np.array([np.cos(camera.yaw_rad), np.sin(camera.yaw_rad)])
    right, down = canvas.pixels(middle).tolist()
    put_text(canvas.image, name, right - text_size(name, 8)[0] / 2, down + 4, 8, (150, 175, 225))


def _draw_points(canvas: _Canvas, points_ego: Float[np.ndarray, "n 3"], height_m: Float[np.ndarray, "n"]) -> None:
    at = canvas.pixels(points_ego)
    inside = ((at >= 0) & (at < canvas.image.shape[0] - 1)).all(1)
    order = np.argsort(height_m[inside])  # high points cover low ones
    colours = (colour_map(height_m[inside][order], -2.0, 4.0, "viridis") * 0.8).astype(np.uint8)
    right, down = at[inside][order].T
    for shift_right, shift_down in ((0, 0), (0, 1), (1, 0), (1, 1)):
        canvas.image[down + shift_down, right + shift_right] = colours


def _draw_boxes(canvas: _Canvas, boxes_ego: Boxes3D, colour: RGB | None) -> None:
    corners = boxes_ego.corners()[:, :4, :2]
    for i in range(len(boxes_ego)):
        tone = colour or class_colour(str(boxes_ego.labels[i]))
        cv2.polylines(canvas.image, [canvas.pixels(corners[i])], True, tone, 3, cv2.LINE_AA)
        centre, front = corners[i].mean(0), (corners[i, 0] + corners[i, 3]) / 2
        start, tip = canvas.pixels(np.stack([centre, front + 0.35 * (front - centre)])).tolist()
        cv2.line(canvas.image, start, tip, tone, 3, cv2.LINE_AA)
