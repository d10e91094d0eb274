"""Run a check: choose frames, inspect them, draw them, write the result."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from coin3d.check.finding import Finding
from coin3d.check.frame_checks import FrameReport
from coin3d.check.inspection import inspect
from coin3d.datasets.open import open_recording
from coin3d.datasets.splits import SplitChoice
from coin3d.drawing.pictures import draw_boxes, draw_ground, draw_points
from coin3d.drawing.sheet import Panel, class_legend, message_picture, save_png, sheet
from coin3d.drawing.top_view import top_view
from coin3d.geometry import Rig

_SHEET_WIDTH_PX = 1920


@dataclass(frozen=True, eq=False)
class CheckResult:
    """Counts over the checked frames, what was found, and where the pictures are.

    Args:
        frames: frames in the recording.
        frames_checked: frames that were read and drawn.
        boxes: annotated boxes in them.
        boxes_with_lidar_count: of these, boxes with an annotated number of LiDAR points.
        boxes_with_matching_lidar_count: of these, boxes in which exactly that many points were found.
        boxes_in_no_image: boxes whose centre no camera sees.
        categories: boxes per category.
        ground_height_m: fitted ground above the rig's, under the ego origin; None without LiDAR.
        ground_tilt_deg: angle between the two planes; None without LiDAR.
        findings: worst first.
        pictures: files written.
    """

    path: Path
    frames: int
    frames_checked: int
    boxes: int
    boxes_with_lidar_count: int
    boxes_with_matching_lidar_count: int
    boxes_in_no_image: int
    categories: dict[str, int]
    ground_height_m: float | None
    ground_tilt_deg: float | None
    findings: tuple[Finding, ...]
    pictures: tuple[Path, ...]

    def as_dict(self) -> dict[str, Any]:
        """The content of result.json."""
        plain = {name: value for name, value in vars(self).items() if name not in ("findings", "pictures", "path")}
        return {
            "path": str(self.path),
            **plain,
            "findings": [finding.as_dict() for finding in self.findings],
            "pictures": [str(picture) for picture in self.pictures],
        }

    def summary(self) -> str:
        """What the command prints."""
        lines = [f"{self.path}: {self.frames} frames, {self.frames_checked} checked, {self.boxes} boxes"]
        if self.boxes_with_lidar_count:
            lines.append(
                f"LiDAR points: {self.boxes_with_matching_lidar_count} of {self.boxes_with_lidar_count} boxes hold exactly "
                "as many as annotated"
            )
        if self.ground_height_m is not None:
            lines.append(f"ground fitted to LiDAR: {self.ground_height_m:+.2f} m, tilted {self.ground_tilt_deg:.1f} deg")
        lines += [str(finding) for finding in self.findings] or ["no findings"]
        return "\n".join([*lines, *(f"picture: {picture}" for picture in self.pictures)])


def check(path: Path, out: Path, frames: int = 3, split: SplitChoice | None = None, undistort: bool = True) -> CheckResult:
    """Check a recording: pictures, counts and findings go to ``out``, and a summary is printed.

    Args:
        path: folder of the recording.
        out: folder for ``result.json`` and the pictures; made if missing.
        frames: how many frames to look at, spread evenly over the recording.
        split: which scenes of it; by default all.
        undistort: as ``open_recording`` takes it.

    Raises:
        FileNotFoundError: not a recording.
        ValueError: nothing of it can be read.
    """
    if frames < 1:
        raise ValueError(f"at least one frame has to be checked, got frames={frames}")
    path, out = Path(path), Path(out)
    recording = open_recording(path, split, undistort=undistort)
    inspection = inspect(recording, frames)
    reports = inspection.reports
    if not any(report.readable for report in reports):
        raise ValueError(f"{path}: nothing of the checked frames can be read; first problem: {inspection.findings[0].text}")
    pictures = [picture for report in reports for picture in _draw(report, out)]
    result = CheckResult(
        path=path,
        frames=len(recording),
        frames_checked=len(reports),
        boxes=sum(len(report.boxes) for report in reports),
        boxes_with_lidar_count=sum(report.counted for report in reports),
        boxes_with_matching_lidar_count=sum(report.matching for report in reports),
        boxes_in_no_image=sum(report.unseen for report in reports),
        categories=dict(sum((report.categories for report in reports), Counter())),
        ground_height_m=inspection.ground_height_m,
        ground_tilt_deg=inspection.ground_tilt_deg,
        findings=inspection.findings,
        pictures=tuple(pictures),
    )
    _write_json(result.as_dict(), out / "result.json")
    print(result.summary())
    return result


def _draw(report: FrameReport, out: Path) -> list[Path]:
    frame = report.frame
    boxes = report.boxes
    panels = []
    for name in _as_seen(frame.rig):
        camera = frame.rig[name]
        caption = f"{name}   {camera.width_px} x {camera.height_px}   f {camera.focal_px:.0f} px   {camera.height_m:.2f} m high"
        if name not in report.images:
            message = next(f.text for f in report.findings if f.where == name)
            panels.append(Panel(message_picture(message, camera.width_px, camera.height_px), caption))
            continue
        if report.scan is not None:
            picture = draw_points(report.images[name], camera, report.scan.points_ego)
        else:
            picture = draw_ground(report.images[name], camera, frame.rig.ground)
        panels.append(Panel(draw_boxes(picture, camera, boxes), caption))
    ahead = sum(abs(camera.yaw_rad) < np.deg2rad(95) for camera in frame.rig.values())
    columns = min(max(ahead, len(panels) - ahead), 5)
    legend = class_legend(boxes.labels.tolist())
    title = "   ".join(dict.fromkeys((frame.scene, frame.token, f"{len(boxes)} boxes")))
    cameras = sheet(panels, columns, _SHEET_WIDTH_PX // columns, title, legend)
    points = None if report.scan is None else report.scan.points_ego
    above = sheet([Panel(top_view(frame.rig, boxes, points_ego=points), "top view, forward is up")], 1, 900, title, legend)
    name = "".join(c if c.isalnum() or c in "-_." else "_" for c in frame.token)
    return [save_png(cameras, out / f"{name}_cameras.png"), save_png(above, out / f"{name}_top.png")]


def _as_seen(rig: Rig) -> list[str]:
    """Forward cameras from left to right, then the others from left to right over the back."""
    ahead = [name for name in rig if abs(rig[name].yaw_rad) < np.deg2rad(95)]
    behind = [name for name in rig if name not in ahead]
    return sorted(ahead, key=lambda n: -rig[n].yaw_rad) + sorted(behind, key=lambda n: rig[n].yaw_rad % (2 * np.pi))


def _write_json(content: dict[str, Any], path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".part")
    partial.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    partial.replace(path)
