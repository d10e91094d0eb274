"""Vehicles drive forwards: what the ego poses and the moving boxes say about the axes they are told in."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from coin3d.check.finding import Finding
from coin3d.check.frame_checks import FrameReport
from coin3d.datasets.frame import Frame, Recording

_FRAMES = 60
_LEAST_MOVE_M = 0.5
_SIDEWAYS_RAD = np.deg2rad(35.0)  # between two frames of a sharp turn it may be half of this
_MIN_MOVES = 2
_BACKWARDS_M = 2.0  # per frame; vehicles reverse slowly
_MIN_OBJECTS = 4


def pose_findings(recording: Recording) -> list[Finding]:
    """Ego poses by which the vehicle would drive sideways, or backwards at speed, among the first frames."""
    moves = list(_moves(recording))
    if len(moves) < _MIN_MOVES:
        return []
    directions = np.array([np.arctan2(y, x) for x, y in moves])
    lengths_m = np.linalg.norm(moves, axis=1)
    sideways = float(np.median(np.abs(np.arctan(np.tan(directions)))))
    backwards = float(np.median(np.abs(directions))) > np.pi / 2
    if sideways <= _SIDEWAYS_RAD and not (backwards and np.median(lengths_m) > _BACKWARDS_M):
        return []
    degrees = np.rad2deg(np.median(np.abs(directions)))
    return [
        Finding(
            "error",
            f"by its poses the vehicle moves at {degrees:.0f} deg to its x axis (median of {len(moves)} moves between frames)",
            "ego poses are world_from_ego with x forward, y left: inverted, or told in another sensor's axes?",
            about="poses",
        )
    ]


def heading_findings(reports: Sequence[FrameReport], neighbours: Mapping[str, Mapping[str, Frame]]) -> list[Finding]:
    """Moving vehicles whose boxes point elsewhere than they go.

    Args:
        reports: inspected frames.
        neighbours: token -> "before" and "after" -> frame, where there are such.
    """
    turns = np.array([turn for report in reports for turn in _turns(report, neighbours.get(report.frame.token, {}))])
    if len(turns) < _MIN_OBJECTS:
        return []
    typical = float(np.median(np.abs(turns)))
    if typical <= _SIDEWAYS_RAD:
        return []
    return [
        Finding(
            "error",
            f"moving objects go at {np.rad2deg(typical):.0f} deg to the heading of their boxes (median of {len(turns)})",
            "yaw is counted from +x to the left and points along the length; check its sign and its zero",
            about="boxes",
        )
    ]


def _moves(recording: Recording) -> Iterator[tuple[float, float]]:
    """Moves between neighbouring frames that are long enough, in the ego axes of the first of them."""
    last: Frame | None = None
    for index in range(min(len(recording), _FRAMES)):
        try:
            frame: Frame | None = recording[index]
        except ValueError:
            frame = None  # reported where frames are inspected
        if frame is not None and last is not None and frame.scene == last.scene:
            x, y, _ = last.world_from_ego.inverse().apply(frame.world_from_ego.translation)
            if np.hypot(x, y) > _LEAST_MOVE_M:
                yield float(x), float(y)
        last = frame


def _turns(report: FrameReport, around: Mapping[str, Frame]) -> Iterator[float]:
    """Angle between heading and way of each object that moves, radians."""
    now = report.frame.boxes_world
    for when, frame in around.items():
        then = frame.boxes_world
        if now is None or then is None:
            continue
        rows = {name: row for row, name in enumerate(then.instance_ids.tolist()) if name}
        sign = 1 if when == "after" else -1
        for row, name in enumerate(now.instance_ids.tolist()):
            if name in rows:
                way = sign * (then.centre_m[rows[name]] - now.centre_m[row])[:2]
                if np.hypot(*way) > 2 * _LEAST_MOVE_M:
                    yield float((np.arctan2(way[1], way[0]) - now.yaw_rad[row] + np.pi) % (2 * np.pi) - np.pi)
