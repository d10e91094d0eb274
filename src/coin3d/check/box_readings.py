"""Do the boxes hold the LiDAR points of their objects? If another reading of the same numbers holds far more, it is meant.

A box whose length and width are swapped, or that turns the wrong way, still lies on its object: only its points tell. Each
reading is compared on those boxes that it changes, so that recordings where it makes no difference give no verdict.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from coin3d.check.finding import Finding
from coin3d.check.frame_checks import FrameReport
from coin3d.datasets.frame import Frame
from coin3d.geometry import Boxes3D, Pose

_RANGE_M = 40.0
_MOST_POINTS = 100  # of a box: one near truck is no better evidence than one car
_MIN_BOXES, _MIN_POINTS = 4, 60
_BETTER, _BETTER_IN_TIME = 1.3, 1.1
_SAME_TURN_RAD = np.deg2rad(8.0)
_SAME_PLACE_M = 0.3


@dataclass
class Tally:
    """Points in boxes as annotated and as read otherwise, over the boxes where that differs."""

    boxes: int = 0
    annotated: float = 0.0
    otherwise: float = 0.0

    def add(self, annotated: Boxes3D, otherwise: Boxes3D, points_ego: Float[np.ndarray, "n 3"]) -> None:
        """Pairs of boxes. Those that hold many points either way are scaled down alike, so that the ratio stays."""
        near = points_ego[np.abs(points_ego[:, :2]).max(1) < _RANGE_M + 10.0]
        mine, other = annotated.count_points(near), otherwise.count_points(near)
        weight = _MOST_POINTS / np.maximum(np.maximum(mine, other), _MOST_POINTS)
        self.boxes += len(annotated)
        self.annotated += float(weight @ mine)
        self.otherwise += float(weight @ other)

    def is_better(self, ratio: float) -> bool:
        """Whether the other reading is clearly meant."""
        enough = self.boxes >= _MIN_BOXES and self.otherwise >= _MIN_POINTS
        return enough and self.otherwise > ratio * max(self.annotated, 1)


def box_findings(reports: Sequence[FrameReport], neighbours: Mapping[str, Mapping[str, Frame]]) -> list[Finding]:
    """The reading of the annotations that holds the most points, if it is not the one they were given in.

    Args:
        reports: inspected frames.
        neighbours: token -> "before" and "after" -> frame, where there are such.
    """
    tallies: dict[str, Tally] = {}
    for report in reports:
        if report.scan is None or report.frame.boxes_world is None or not len(report.boxes):
            continue
        for text, read in _readings(report.frame).items():
            _compare(tallies.setdefault(text, Tally()), report.boxes, read(report.boxes), report.scan.points_ego)
        for when, frame in neighbours.get(report.frame.token, {}).items():
            if frame.boxes_world is not None:
                there = frame.boxes_world.transformed(report.frame.world_from_ego.inverse())
                tally = tallies.setdefault(f"{_TIME} {when}", Tally())
                _compare_in_time(tally, report.boxes, there, report.scan.points_ego)
    better = {t: c for t, c in tallies.items() if c.is_better(_BETTER_IN_TIME if t.startswith(_TIME) else _BETTER)}
    if not better:
        return []
    text = max(better, key=lambda t: better[t].otherwise / max(better[t].annotated, 1))
    tally = better[text]
    points = f"{tally.annotated:.0f} LiDAR points (at most {_MOST_POINTS} of each count), and {tally.otherwise:.0f}"
    fact = f"{tally.boxes} boxes hold {points} if they are read as {text}"
    return [Finding("error", fact, "correct the annotations, or the pose of the LiDAR", about="boxes")]


_TIME = "those of the frame"
_Read = Callable[[Boxes3D], Boxes3D]


def _readings(frame: Frame) -> dict[str, _Read]:
    """What people mix up, as functions of boxes in the ego frame."""
    world_yaw = frame.world_from_ego.yaw_rad
    wide = frame.boxes is not None and np.median(frame.boxes.size_m[:, 0] - frame.boxes.size_m[:, 1]) < 0
    quarter = "boxes with length and width swapped" if wide else "boxes with the yaw counted from the y axis"
    return {
        quarter: lambda b: replace(b, size_m=b.size_m[:, [1, 0, 2]], yaw_rad=b.yaw_rad),
        "boxes with the other sign of yaw": lambda b: replace(b, yaw_rad=-b.yaw_rad - 2 * world_yaw),
        "boxes with the other sign of yaw, in the ego frame": lambda b: replace(b, yaw_rad=-b.yaw_rad),
        "boxes whose centre is that of the bottom": lambda b: _lifted(b, 0.5),
        "boxes whose centre is that of the top": lambda b: _lifted(b, -0.5),
        "boxes with the other sign of y": lambda b: replace(b, centre_m=b.centre_m * [1, -1, 1], yaw_rad=-b.yaw_rad),
        "boxes in the ego frame, not in the world": lambda b: b.transformed(frame.world_from_ego),
        "boxes a quarter turn to the left of the LiDAR": lambda b: b.transformed(_turn(90)),
        "boxes a quarter turn to the right of the LiDAR": lambda b: b.transformed(_turn(-90)),
        "boxes half a turn from the LiDAR": lambda b: b.transformed(_turn(180)),
    }


def _lifted(boxes: Boxes3D, heights: float) -> Boxes3D:
    return replace(boxes, centre_m=boxes.centre_m + boxes.size_m * [0, 0, heights])


def _turn(degrees: float) -> Pose:
    return Pose.from_euler(np.deg2rad(degrees), 0, 0, np.zeros(3))


def _compare(tally: Tally, given: Boxes3D, read: Boxes3D, points_ego: Float[np.ndarray, "n 3"]) -> None:
    # an upright box looks the same after half a turn
    turn = np.abs((read.yaw_rad - given.yaw_rad + np.pi / 2) % np.pi - np.pi / 2)
    turned = (turn > _SAME_TURN_RAD) & (np.abs(given.size_m[:, 0] - given.size_m[:, 1]) > _SAME_PLACE_M)
    swapped = np.abs(read.size_m - given.size_m).max(1, initial=0) > _SAME_PLACE_M
    moved = np.linalg.norm(read.centre_m - given.centre_m, axis=1) > _SAME_PLACE_M
    near = np.minimum(*(np.linalg.norm(b.centre_m[:, :2], axis=1) for b in (given, read))) < _RANGE_M
    rows = (turned | swapped | moved) & near
    tally.add(given[rows], read[rows], points_ego)


def _compare_in_time(tally: Tally, given: Boxes3D, other: Boxes3D, points_ego: Float[np.ndarray, "n 3"]) -> None:
    """Only objects with a name are compared: those in both frames that moved in between."""
    names = {name: row for row, name in enumerate(other.instance_ids.tolist()) if name}
    pairs = np.array([(row, names[n]) for row, n in enumerate(given.instance_ids.tolist()) if n in names], dtype=int)
    if not len(pairs):
        return
    mine, theirs = given[pairs[:, 0]], other[pairs[:, 1]]
    moved = np.linalg.norm(mine.centre_m - theirs.centre_m, axis=1) > _SAME_PLACE_M
    rows = moved & (np.linalg.norm(mine.centre_m[:, :2], axis=1) < _RANGE_M)
    tally.add(mine[rows], theirs[rows], points_ego)
