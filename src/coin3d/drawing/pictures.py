"""Boxes and LiDAR points drawn into a camera's image."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from coin3d.drawing.colours import RGB, class_colour, colour_map
from coin3d.drawing.text import put_text
from coin3d.geometry import Boxes3D, Camera, GroundPlane

_NEAR_M = 0.2
# corner pairs of Boxes3D.corners: bottom, top, uprights
_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
_FRONT_FACE = (0, 3, 7, 4)
# an edge is drawn in pieces because a lens may bend it
_PIECES = 12


def draw_boxes(
    image: UInt8[np.ndarray, "h w 3"],
    camera: Camera,
    boxes_ego: Boxes3D,
    colour: RGB | None = None,
    with_scores: bool = False,
) -> UInt8[np.ndarray, "h w 3"]:
    """The image with the boxes' edges, far ones first; the front face is tinted and crossed.

    Edges are cut at the image plane, so a box around or beside the camera does not draw across the picture.

    Args:
        image: of the camera's size.
        camera: its calibration.
        boxes_ego: in the ego frame.
        colour: one colour for all, default by class.
        with_scores: write the score at each box.
    """
    _require_size(image, camera)
    out = image.copy()
    thickness = max(1, round(image.shape[1] / 800))
    corners = boxes_ego.corners()
    for i in np.argsort(-np.linalg.norm(boxes_ego.centre_m - camera.ego_from_cam.translation, axis=1)):
        box_colour = colour or class_colour(str(boxes_ego.labels[i]))
        lines = [line for a, b in _EDGES for line in project_line(camera, corners[i, a], corners[i, b])]
        if not any(_touches(line, image.shape[1], image.shape[0]) for line in lines):
            continue
        _tint_front(out, camera, corners[i, _FRONT_FACE, :], box_colour, thickness)
        _draw_lines(out, lines, box_colour, thickness)
        if with_scores:
            top = min((line for line in lines if len(line)), key=lambda line: float(line[:, 1].min()))
            left, upper = top[np.argmin(top[:, 1])]
            size = max(10.0, image.shape[1] / 90)
            put_text(out, f"{boxes_ego.scores[i]:.2f}", left, max(float(upper) - 3, size), size, box_colour)
    return out


def draw_points(
    image: UInt8[np.ndarray, "h w 3"], camera: Camera, points_ego: Float[np.ndarray, "n 3"], max_depth_m: float = 60.0
) -> UInt8[np.ndarray, "h w 3"]:
    """The image with points coloured by depth, near red to far blue; near points cover far ones.

    Args:
        image: of the camera's size.
        camera: its calibration.
        points_ego: in the ego frame.
        max_depth_m: depth at the blue end.
    """
    _require_size(image, camera)
    out = image.copy()
    seen = points_ego[camera.sees(points_ego)]
    pixels, depth_m = camera.project(seen)
    order = np.argsort(-depth_m)
    colours = colour_map(-np.log(depth_m[order].clip(2.0, max_depth_m)), -np.log(max_depth_m), -np.log(2.0))
    radius = max(1, round(image.shape[1] / 800))
    for (u, v), tone in zip(np.floor(pixels[order]).astype(int).tolist(), colours.tolist(), strict=True):
        cv2.circle(out, (u, v), radius, tone, -1, cv2.LINE_AA)
    return out


def draw_ground(image: UInt8[np.ndarray, "h w 3"], camera: Camera, ground: GroundPlane) -> UInt8[np.ndarray, "h w 3"]:
    """The image with the ground plane as rings of 5, 10, 20, 40 m around the ego origin and a spoke every 15 degrees.

    The rings must lie on the road and the spokes must meet its vanishing points: a check of a rig without LiDAR.
    """
    _require_size(image, camera)
    out = image.copy()
    thickness = max(1, round(image.shape[1] / 900))
    angles = np.deg2rad(np.arange(0, 361, 5))
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    for radius_m, colour in ((5.0, (255, 90, 80)), (10.0, (255, 190, 60)), (20.0, (110, 220, 110)), (40.0, (90, 170, 255))):
        ring = _on_ground(radius_m * directions, ground)
        for a, b in pairwise(ring):
            _draw_lines(out, project_line(camera, a, b), colour, thickness)
    for direction in directions[:-1:3]:
        start, end = _on_ground(np.stack([2.0 * direction, 40.0 * direction]), ground)
        _draw_lines(out, project_line(camera, start, end), (225, 225, 225), max(1, thickness // 2))
    return out


def _on_ground(xy: Float[np.ndarray, "n 2"], ground: GroundPlane) -> Float[np.ndarray, "n 3"]:
    z = -(xy @ ground.normal[:2] + ground.offset_m) / ground.normal[2]
    return np.concatenate([xy, z[:, None]], axis=1)


def project_line(
    camera: Camera, start_ego: Float[np.ndarray, "3"], end_ego: Float[np.ndarray, "3"]
) -> list[Float[np.ndarray, "_ 2"]]:
    """The part of a 3D line segment in front of the camera as polylines of pixels: one, or what a lens shows of it."""
    _, depth_m = camera.project(np.stack([start_ego, end_ego]))
    depth_start, depth_end = float(depth_m[0]), float(depth_m[1])
    if max(depth_start, depth_end) <= _NEAR_M:
        return []
    first, last = 0.0, 1.0
    if min(depth_start, depth_end) < _NEAR_M:
        crossing = (_NEAR_M - depth_start) / (depth_end - depth_start)
        first, last = (crossing, 1.0) if depth_start < _NEAR_M else (0.0, crossing)
    share = np.linspace(first, last, _PIECES + 1)[:, None]
    pixels, _ = camera.project(start_ego + share * (end_ego - start_ego))
    shown = np.isfinite(pixels).all(1)
    if shown.all():
        return [pixels]
    runs = np.split(np.arange(len(pixels)), np.flatnonzero(shown[1:] != shown[:-1]) + 1)
    return [pixels[run] for run in runs if shown[run[0]] and len(run) > 1]


def _tint_front(
    out: UInt8[np.ndarray, "h w 3"], camera: Camera, face: Float[np.ndarray, "4 3"], colour: RGB, thickness: int
) -> None:
    outline = _in_front(camera, face)
    if len(outline) < 3:
        return
    pixels, _ = camera.project(outline)
    if not np.isfinite(pixels).all():
        return  # reaches beyond what the lens shows
    height, width = out.shape[:2]
    low = np.floor(pixels.min(0)).clip(0, (width, height)).astype(int)
    high = np.ceil(pixels.max(0) + 1).clip(0, (width, height)).astype(int)
    if (high <= low).any():
        return
    part = out[low[1] : high[1], low[0] : high[0]]
    tinted = part.copy()
    cv2.fillPoly(tinted, [np.round((pixels - low).clip(-1e5, 1e5)).astype(np.int32)], colour)
    part[:] = cv2.addWeighted(part, 0.72, tinted, 0.28, 0.0)
    for a, b in ((0, 2), (1, 3)):
        _draw_lines(out, project_line(camera, face[a], face[b]), colour, thickness)


def _in_front(camera: Camera, polygon: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "m 3"]:
    """The polygon cut at the near plane (Sutherland-Hodgman with one plane)."""
    _, depth_m = camera.project(polygon)
    kept: list[np.ndarray] = []
    for i in range(len(polygon)):
        j = (i + 1) % len(polygon)
        if depth_m[i] >= _NEAR_M:
            kept.append(polygon[i])
        if (depth_m[i] >= _NEAR_M) != (depth_m[j] >= _NEAR_M):
            share = (_NEAR_M - depth_m[i]) / (depth_m[j] - depth_m[i])
            kept.append(polygon[i] + share * (polygon[j] - polygon[i]))
    return np.reshape(kept, (-1, 3))


def _draw_lines(out: UInt8[np.ndarray, "h w 3"], lines: list[Float[np.ndarray, "_ 2"]], colour: RGB, thickness: int) -> None:
    for line in lines:
        # far outside the picture the raster routines overflow; nothing visible lies there
        points = np.floor(line.clip(-1e5, 1e5)).astype(int).tolist()
        for a, b in pairwise(points):
            inside, a, b = cv2.clipLine((-50, -50, out.shape[1] + 100, out.shape[0] + 100), a, b)
            if inside:
                cv2.line(out, a, b, colour, thickness, cv2.LINE_AA)


def _touches(line: Float[np.ndarray, "k 2"], width: int, height: int) -> bool:
    points = line.clip(-1e5, 1e5).astype(int).tolist()
    return any(cv2.clipLine((0, 0, width, height), a, b)[0] for a, b in pairwise(points))


def _require_size(image: UInt8[np.ndarray, "h w 3"], camera: Camera) -> None:
    if image.shape[:2] != (camera.height_px, camera.width_px):
        raise ValueError(
            f"an image of {image.shape[1]} x {image.shape[0]} pixels with a camera of {camera.width_px} x {camera.height_px}: "
            "transform both together (geometry.ImageTransform)"
        )
