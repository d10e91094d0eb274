"""Detections, and the truth where it is known, in every image of a frame and from above."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from coin3d.datasets.frame import Frame
from coin3d.drawing.colours import PREDICTION, RGB, TRUTH
from coin3d.drawing.pictures import draw_boxes
from coin3d.drawing.sheet import Panel, class_legend, save_png, sheet
from coin3d.drawing.top_view import top_view
from coin3d.geometry import Boxes3D, Rig

_FORWARD_RAD = np.deg2rad(75)  # the sides go to the second row, so that images stay large


@dataclass(frozen=True, eq=False)
class FramePictures:
    """Two pictures of one frame.

    Args:
        cameras: all images of the rig in the order of view.
        above: the scene from above, forward up.
    """

    cameras: UInt8[np.ndarray, "h w 3"]
    above: UInt8[np.ndarray, "s s 3"]

    def save(self, folder: Path, name: str) -> list[Path]:
        """Write both as PNG."""
        name = file_name(name)
        return [save_png(self.cameras, folder / f"{name}_cameras.png"), save_png(self.above, folder / f"{name}_top.png")]


def file_name(token: str) -> str:
    """A token as a file name: characters that do not belong in one become underscores."""
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in token)


def frame_pictures(
    frame: Frame,
    predictions: Boxes3D,
    truth: Boxes3D | None = None,
    *,
    title: str = "",
    width_px: int = 1920,
    top_px: int = 900,
) -> FramePictures:
    """Draw a frame. With truth, truth and predictions have one colour each; without, predictions are coloured by class.

    Args:
        frame: images and rig.
        predictions: ego frame; all of them are drawn, so drop unlikely ones before.
        truth: ego frame.
        title: line above the images.
        width_px: width of the sheet of images.
        top_px: side of the top view.
    """
    panels = []
    for name in as_seen(frame.rig):
        camera, image = frame.rig[name], frame.image(name)
        if truth is not None:
            image = draw_boxes(image, camera, truth, TRUTH)
        image = draw_boxes(image, camera, predictions, PREDICTION if truth is not None else None, with_scores=truth is None)
        panels.append(Panel(image, f"{name}   {camera.width_px} x {camera.height_px}   f {camera.focal_px:.0f} px"))
    columns = _columns(frame.rig)
    cell_px = width_px // columns
    if truth is None:
        above = top_view(frame.rig, predictions, size_px=top_px)
    else:
        above = top_view(frame.rig, truth, predictions, size_px=top_px)
    return FramePictures(sheet(panels, columns, cell_px, title, _legend(predictions, truth)), above)


def _legend(predictions: Boxes3D, truth: Boxes3D | None) -> list[tuple[str, RGB]]:
    if truth is None:
        return class_legend(predictions.labels.tolist())
    return [(f"truth ({len(truth)})", TRUTH), (f"predictions ({len(predictions)})", PREDICTION)]


def as_seen(rig: Rig) -> list[str]:
    """Camera names: those looking forward from left to right, then the others from left to right over the back."""
    ahead = [name for name in rig if abs(rig[name].yaw_rad) < _FORWARD_RAD]
    behind = [name for name in rig if name not in ahead]
    return sorted(ahead, key=lambda n: -rig[n].yaw_rad) + sorted(behind, key=lambda n: rig[n].yaw_rad % (2 * np.pi))


def _columns(rig: Rig) -> int:
    ahead = len([name for name in rig if abs(rig[name].yaw_rad) < _FORWARD_RAD])
    return min(max(ahead, len(rig) - ahead, 1), 5)


def likely(boxes: Boxes3D, min_score: float) -> Boxes3D:
    """The boxes with at least that score."""
    return boxes[boxes.scores >= min_score]
