"""Everything that can be found out about a recording, without drawing it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coin3d.check.box_readings import box_findings
from coin3d.check.finding import Finding
from coin3d.check.frame_checks import FrameReport, inspect_frame
from coin3d.check.image_alignment import image_findings
from coin3d.check.lidar_counts import count_findings
from coin3d.check.motion_checks import heading_findings, pose_findings
from coin3d.check.recording_checks import coverage, ground_against_lidar, time_gaps
from coin3d.check.rig_checks import rig_findings
from coin3d.check.sweep_overlap import sweep_findings
from coin3d.datasets.frame import Frame, Recording


@dataclass(frozen=True, eq=False)
class Inspection:
    """What was found.

    Args:
        reports: of the frames that could be built.
        findings: worst first.
        ground_height_m: fitted ground above the rig's, under the ego origin; None without LiDAR.
        ground_tilt_deg: angle between the two planes; None without LiDAR.
    """

    reports: tuple[FrameReport, ...]
    findings: tuple[Finding, ...]
    ground_height_m: float | None = None
    ground_tilt_deg: float | None = None


def inspect(recording: Recording, frames: int) -> Inspection:
    """Look at frames spread evenly over a recording, and at their neighbours. What cannot be read becomes a finding."""
    findings: list[Finding] = []
    reports: list[FrameReport] = []
    neighbours: dict[str, dict[str, Frame]] = {}
    for index in sorted({round(i) for i in np.linspace(0, len(recording) - 1, frames)}):
        try:
            frame = recording[index]
        except ValueError as error:
            findings.append(Finding("error", str(error), "correct the recording", f"frame {index}"))
            continue
        reports.append(inspect_frame(frame))
        neighbours[frame.token] = _neighbours(recording, index, frame)
    findings += [finding for report in reports for finding in report.findings]
    if not any(report.readable for report in reports):
        return Inspection(tuple(reports), _sorted(findings))
    height_m, tilt_deg, ground_findings = ground_against_lidar(reports)
    findings += rig_findings(reports[0].frame.rig) + ground_findings + coverage(reports)
    wrong_poses = pose_findings(recording) or sweep_findings(reports, neighbours)
    # ways of objects are told by the same poses
    findings += wrong_poses or heading_findings(reports, neighbours)
    findings += time_gaps(recording) + count_findings(reports) + box_findings(reports, neighbours)
    findings += image_findings(reports, neighbours)
    return Inspection(tuple(reports), _sorted(findings), height_m, tilt_deg)


def _neighbours(recording: Recording, index: int, frame: Frame) -> dict[str, Frame]:
    found = {}
    for when, other in (("before", index - 1), ("after", index + 1)):
        if 0 <= other < len(recording):
            try:
                neighbour = recording[other]
            except ValueError:
                continue  # a finding only if it is among the frames that are looked at
            if neighbour.scene == frame.scene:
                found[when] = neighbour
    return found


def _sorted(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    order = {"error": 0, "warning": 1, "note": 2}
    return tuple(sorted(dict.fromkeys(findings), key=lambda finding: order[finding.severity]))
