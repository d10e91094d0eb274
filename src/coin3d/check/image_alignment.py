"""Do the images show what the LiDAR saw? Edges of depth lie on edges of brightness, if camera, pose and time are right.

Where one object ends in front of another, depth jumps from one column of the image to the next, and brightness mostly does too.
How much brighter the gradient is there than where the same edges fall when they are moved sideways tells whether image and
LiDAR belong together: no threshold on brightness or texture is needed. The same measure for the images of other cameras, of the
frames before and after, and for the mirrored image tells what was mixed up.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from coin3d.check.finding import Finding
from coin3d.check.frame_checks import FrameReport
from coin3d.datasets.frame import Frame
from coin3d.geometry import Camera

_COLUMNS = 120  # cells across an image, square: half a degree each in a usual camera
_DEPTH_RATIO = 0.15  # a jump in log depth that counts as an edge
_REACH = 15  # cells that edges are moved to either side
_PEAK = 1  # a move this small still meets the same edge
_MIN_EDGES = 60  # over all frames
_SURE, _CLEARER, _UNSURE = 4.5, 3.0, 2.0
_BRIGHTEST = 4.0  # times the mean gradient; a white line on asphalt is no better evidence than a car before a wall


@dataclass
class Alignment:
    """Gradient at the edges of depth, summed over frames, at every sideways move from -15 to +15 cells."""

    gradient: Float[np.ndarray, "31"]
    edges: Float[np.ndarray, "31"]

    @classmethod
    def none(cls) -> Alignment:
        return cls(np.zeros(2 * _REACH + 1), np.zeros(2 * _REACH + 1))

    def add(self, edges: Bool[np.ndarray, "h w"], gradient: Float[np.ndarray, "h w"]) -> None:
        """Another frame; images of other sizes are compared from the top."""
        rows = min(len(edges), len(gradient))
        row, column = np.nonzero(edges[:rows])
        for k, move in enumerate(range(-_REACH, _REACH + 1)):
            inside = (column + move >= 0) & (column + move < gradient.shape[1])
            self.gradient[k] += gradient[row[inside], column[inside] + move].sum()
            self.edges[k] += inside.sum()

    def clearness(self, blur: int = 0) -> Float[np.ndarray, "31"]:
        """How many standard deviations each move stands out from those that are not beside it; zeros with too few edges.

        Args:
            blur: moves to either side that are averaged: away from the middle, edges fall a little apart.
        """
        if self.edges.min() < _MIN_EDGES:
            return np.zeros(len(self.edges))
        mean = self.gradient / self.edges
        if blur:
            mean = np.convolve(np.pad(mean, blur, mode="edge"), np.full(2 * blur + 1, 1 / (2 * blur + 1)), mode="valid")
        out = np.zeros(len(mean))
        for k in range(len(mean)):
            others = np.delete(mean, slice(max(0, k - _PEAK - blur), k + _PEAK + blur + 1))
            out[k] = (mean[k] - others.mean()) / max(others.std(), 1e-6)
        return out

    @property
    def score(self) -> float:
        """Clearness without a move."""
        return float(self.clearness()[_REACH])


def depth_edges(points_ego: Float[np.ndarray, "n 3"], camera: Camera) -> Bool[np.ndarray, "rows 119"]:
    """Where LiDAR depth jumps from one cell to the next in its row."""
    pixels, depth_m = camera.project(points_ego)
    seen = camera.in_image(pixels, depth_m)
    cell_px = camera.width_px / _COLUMNS
    nearest = np.full((_rows(camera.height_px, camera.width_px) + 2, _COLUMNS), np.inf)
    column, row = np.floor(pixels[seen] / cell_px).astype(int).T
    np.minimum.at(nearest, (row + 1, np.minimum(column, _COLUMNS - 1)), depth_m[seen])
    # beams are farther apart than cells are high: a row borrows from its neighbours
    nearest = np.minimum(np.minimum(nearest[:-2], nearest[1:-1]), nearest[2:])
    with np.errstate(invalid="ignore"):
        jump = np.abs(np.diff(np.log(nearest), axis=1))
    return np.asarray(np.isfinite(jump) & (jump > _DEPTH_RATIO))


def edge_brightness(image: UInt8[np.ndarray, "h w 3"]) -> Float[np.ndarray, "rows 119"]:
    """The steepest horizontal gradient around each boundary between cells, relative to the mean of the image."""
    fine = 4
    rows = _rows(*image.shape[:2])
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    grey = cv2.resize(grey, (_COLUMNS * fine, rows * fine), interpolation=cv2.INTER_AREA)
    blurred = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), 1.0)
    steep = np.abs(cv2.Sobel(blurred, cv2.CV_32F, 1, 0, ksize=3)).reshape(rows, fine, -1).max(1)
    around = np.stack([steep[:, k * fine + 2 : k * fine + 6].max(1) for k in range(_COLUMNS - 1)], axis=1)
    return np.asarray(np.minimum(around / max(float(around.mean()), 1e-6), _BRIGHTEST), dtype=np.float64)


def image_findings(reports: Sequence[FrameReport], neighbours: Mapping[str, Mapping[str, Frame]]) -> list[Finding]:
    """Images that do not show what the LiDAR saw, and what would fit instead.

    Args:
        reports: inspected frames.
        neighbours: token -> "before" and "after" -> frame, where there are such.
    """
    names = list(reports[0].frame.rig)
    own = {name: Alignment.none() for name in names}
    other: dict[str, dict[str, Alignment]] = {name: {} for name in names}
    for report in reports:
        if report.scan is None:
            continue
        shown = {name: edge_brightness(image) for name, image in report.images.items()}
        around = _shown_around(neighbours.get(report.frame.token, {}), names)
        for name in (n for n in names if n in shown and n in report.frame.rig):
            edges = depth_edges(report.scan.points_ego, report.frame.rig[name])
            own[name].add(edges, shown[name])
            instead = {f"of {n}": shown[n] for n in shown if n != name}
            instead["mirrored"] = shown[name][:, ::-1]
            instead |= {f"of the frame {when}": views[name] for when, views in around.items() if name in views}
            for what, brightness in instead.items():
                other[name].setdefault(what, Alignment.none()).add(edges, brightness)
    return [finding for name in names for finding in _judge(name, own[name], other[name])]


def _judge(name: str, own: Alignment, other: Mapping[str, Alignment]) -> list[Finding]:
    scores = {what: alignment.score for what, alignment in other.items()}
    best = max(scores, key=lambda what: scores[what], default="")
    if best and scores[best] > max(_SURE, own.score + _CLEARER):
        text = (
            f"the image does not show what the LiDAR saw ({own.score:.1f} standard deviations), the one {best} does "
            f"({scores[best]:.1f})"
        )
        remedy = {"mirrored": "do not flip images, or flip K with them"}.get(
            best, "wrong files or times: images belong to the camera and the instant they are stored under"
        )
        return [Finding("error", text, remedy, name, about="images")]
    clearness = np.maximum(own.clearness(), own.clearness(blur=1))
    move = int(clearness.argmax()) - _REACH
    if abs(move) > _PEAK + 1 and clearness.max() > max(_SURE, own.score + _CLEARER) and clearness[_REACH] < _UNSURE:
        side = "right" if move > 0 else "left"
        text = f"LiDAR and image would fit {abs(move) / _COLUMNS:.1%} of the image's width further {side}"
        remedy = "the camera's yaw, its principal point or its time is off"
        return [Finding("warning", text, remedy, name, about="cameras")]
    return []


def _shown_around(frames: Mapping[str, Frame], names: Sequence[str]) -> dict[str, dict[str, np.ndarray]]:
    found: dict[str, dict[str, np.ndarray]] = {}
    for when, frame in frames.items():
        for name in (n for n in names if n in frame.images):
            try:
                found.setdefault(when, {})[name] = edge_brightness(frame.image(name))
            except ValueError:
                continue  # reported where that frame is inspected
    return found


def _rows(height_px: int, width_px: int) -> int:
    return max(1, round(height_px * _COLUMNS / width_px))
