"""Measurements and findings of one frame: files, LiDAR against boxes and cameras, boxes against cameras and ground."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Int, UInt8

from coin3d.check.finding import Finding
from coin3d.datasets.classes import KNOWN_CATEGORIES
from coin3d.datasets.frame import Frame, LidarScan
from coin3d.datasets.ground_fit import GroundFit, fit_ground
from coin3d.geometry import Boxes3D

_NEAR_BOX_M = 20.0
_MAX_FLOAT_M = 0.5


@dataclass
class FrameReport:
    """What was read and measured in one frame.

    Args:
        images: camera name -> RGB, only those that could be read.
        scan: the LiDAR sweep, if it could be read.
        found_points: LiDAR points in each box that has an annotated number of them.
        annotated_points: that number.
        unseen: boxes whose centre is in no image.
        categories: boxes per category name.
        ground: the plane fitted to the LiDAR.
    """

    frame: Frame
    images: dict[str, UInt8[np.ndarray, "h w 3"]] = field(default_factory=dict)
    scan: LidarScan | None = None
    found_points: Int[np.ndarray, "n"] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    annotated_points: Int[np.ndarray, "n"] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    unseen: int = 0
    categories: Counter[str] = field(default_factory=Counter)
    ground: GroundFit | None = None
    findings: list[Finding] = field(default_factory=list)

    @property
    def boxes(self) -> Boxes3D:
        """Annotations in the ego frame, empty where there are none."""
        return self.frame.boxes if self.frame.boxes is not None else Boxes3D.empty()

    @property
    def counted(self) -> int:
        """Boxes with an annotated number of LiDAR points, and a sweep to count in."""
        return len(self.annotated_points)

    @property
    def matching(self) -> int:
        """Of these, boxes that hold exactly that many."""
        return int((self.found_points == self.annotated_points).sum())

    @property
    def readable(self) -> bool:
        return bool(self.images) or self.scan is not None


def inspect_frame(frame: Frame) -> FrameReport:
    """Read and measure a frame. What cannot be read becomes a finding, never an exception."""
    report = FrameReport(frame)
    for camera in frame.rig:
        try:
            report.images[camera] = frame.image(camera)
        except ValueError as error:
            report.findings.append(Finding("error", str(error), "replace the file or leave the frame out", camera, "files"))
    if frame.lidar is not None:
        try:
            report.scan = frame.lidar.load()
        except ValueError as error:
            report.findings.append(
                Finding("error", str(error), "replace the file or leave the frame out", frame.token, "files")
            )
    if report.scan is not None:
        _check_lidar(report, report.scan)
    if len(report.boxes):
        _check_boxes(report)
    return report


def _check_lidar(report: FrameReport, scan: LidarScan) -> None:
    frame = report.frame
    report.ground = fit_ground(scan.points_ego, scan.origin_ego)
    for name, camera in frame.rig.items():
        if not camera.sees(scan.points_ego).any():
            text = "no LiDAR point falls into the image"
            remedy = "check the pose of this camera and of the LiDAR; depth supervision has nothing to learn from here"
            report.findings.append(Finding("warning", text, remedy, name, "lidar"))
    if frame.boxes_world is None:
        return
    # in the world, where annotators' boxes are upright: the ego frame leans with the vehicle
    counts = frame.boxes_world.count_points(frame.world_from_ego.apply(scan.points_ego))
    annotated = frame.boxes_world.num_lidar_points
    known = annotated >= 0
    report.found_points, report.annotated_points = counts[known], annotated[known]


def _check_boxes(report: FrameReport) -> None:
    boxes, frame = report.boxes, report.frame
    report.categories = Counter(map(str, boxes.labels))
    unknown = sorted(set(report.categories) - KNOWN_CATEGORIES)
    if unknown:
        text = f"unknown categories: {', '.join(unknown)}"
        report.findings.append(Finding("warning", text, "training refuses them; rename them (docs/datasets.md)", about="boxes"))
    report.unseen = int((~frame.rig.sees(boxes.centre_m)).sum())
    near = boxes[np.linalg.norm(boxes.centre_m[:, :2], axis=1) < _NEAR_BOX_M]
    if len(near):
        bottoms = near.centre_m - np.array([0, 0, 0.5]) * near.size_m
        height_m = float(np.median(frame.rig.ground.height_m(bottoms)))
        if abs(height_m) > _MAX_FLOAT_M:
            report.findings.append(
                Finding(
                    "warning",
                    f"box bottoms lie {height_m:+.2f} m from the ground (median of the {len(near)} nearest boxes)",
                    "box centres must be centres of gravity, and the rig's ground the real one",
                    frame.token,
                    "boxes",
                )
            )
