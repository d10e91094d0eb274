"""Findings over all checked frames: the ground, what the cameras cover, time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coin3d.check.finding import Finding
from coin3d.check.frame_checks import FrameReport
from coin3d.datasets.frame import Frame, Recording
from coin3d.datasets.ground_fit import GroundFit
from coin3d.geometry import GroundPlane, Rig

_MAX_HEIGHT_ERROR_M = 0.15
_MAX_TILT_DEG, _MAX_TILT_OF_FEW_DEG = 1.0, 2.5
_FEW_FRAMES = 3  # a vehicle that brakes, or stands on a crowned road, leans by a degree or two
_AT_SENSOR_M, _SENSOR_HEIGHT_M = 0.05, (0.8, 4.0)
_FRAMES_FOR_GAPS = 200


def ground_against_lidar(reports: Sequence[FrameReport]) -> tuple[float | None, float | None, list[Finding]]:
    """Height (metres, under the ego origin) and tilt (degrees) of the LiDAR's ground against the rig's, and findings."""
    fits = [report.ground for report in reports if report.ground is not None]
    rig = reports[0].frame.rig
    if not fits:
        return None, None, [_no_fit(reports, rig)]
    plane = _median_plane(fits)
    under_ego = -rig.ground.offset_m * rig.ground.normal
    height_m = -float(plane.height_m(under_ego))
    tilt_deg = float(np.rad2deg(np.arccos(np.clip(plane.normal @ rig.ground.normal, -1, 1))))
    max_tilt_deg = _MAX_TILT_DEG if len(fits) >= _FEW_FRAMES else _MAX_TILT_OF_FEW_DEG
    if abs(height_m) <= _MAX_HEIGHT_ERROR_M and tilt_deg <= max_tilt_deg:
        return height_m, tilt_deg, []
    if _starts_at_sensor(reports) and _SENSOR_HEIGHT_M[0] < -height_m < _SENSOR_HEIGHT_M[1]:
        text = f"the LiDAR sits at the origin, {-height_m:.2f} m above ground: its own frame was taken for the ego frame"
        remedy = "move its points by the pose of the sensor, ego_from_lidar (translation and rotation)"
        return height_m, tilt_deg, [Finding("error", text, remedy, about="lidar")]
    normal = ", ".join(f"{x:.4f}" for x in plane.normal)
    finding = Finding(
        "warning",
        f"the ground fitted to LiDAR lies {height_m:+.2f} m from the rig's and is tilted {tilt_deg:.1f} deg "
        f"(median of {len(fits)} frames; limits {_MAX_HEIGHT_ERROR_M} m, {max_tilt_deg:g} deg)",
        "in one frame: the vehicle leans or the road slopes; in all: the ego frame does not start on the ground, set "
        f"ground: {{normal: [{normal}], offset: {plane.offset_m:.3f}}} in the rig, or correct its poses",
        about="ground",
    )
    return height_m, tilt_deg, [finding]


def _starts_at_sensor(reports: Sequence[FrameReport]) -> bool:
    origins = [np.linalg.norm(report.scan.origin_ego) for report in reports if report.scan is not None]
    return bool(origins) and bool(max(origins) < _AT_SENSOR_M)


def _no_fit(reports: Sequence[FrameReport], rig: Rig) -> Finding:
    if any(report.scan is not None for report in reports):
        return Finding(
            "note",
            "too few LiDAR points near the vehicle to fit the ground",
            "look at the boxes' bottoms instead",
            about="ground",
        )
    heights = ", ".join(f"{name} {rig.ground.height_m(camera.ego_from_cam.translation):.2f} m" for name, camera in rig.items())
    return Finding(
        "note",
        f"no LiDAR to verify the ground: cameras are {heights} above it",
        "measure one camera's height; in the pictures the rings (5, 10, 20, 40 m) must lie on the road",
        about="ground",
    )


def _median_plane(fits: Sequence[GroundFit]) -> GroundPlane:
    normals = [fit.plane.normal for fit in fits]
    return GroundPlane(np.median(normals, axis=0), float(np.median([fit.plane.offset_m for fit in fits])))


def coverage(reports: Sequence[FrameReport]) -> list[Finding]:
    """Annotations that no camera sees, or none at all."""
    findings = []
    unseen, boxes = sum(r.unseen for r in reports), sum(len(r.boxes) for r in reports)
    if unseen:
        findings.append(
            Finding(
                "note" if unseen < boxes / 2 else "warning",
                f"{unseen} of {boxes} boxes have their centre in no image",
                "they are not scored by default; most of them: check the camera poses",
                about="cameras",
            )
        )
    if all(report.frame.boxes_world is None for report in reports):
        findings.append(
            Finding("note", "no annotations", "enough for detection; training and evaluation need boxes", about="boxes")
        )
    return findings


def time_gaps(recording: Recording) -> list[Finding]:
    """Steps within a scene that are far from the usual one, or go backwards, among the first frames."""
    steps: list[tuple[str, float]] = []
    last: Frame | None = None
    for index in range(min(len(recording), _FRAMES_FOR_GAPS)):
        try:
            frame = recording[index]
        except ValueError:
            frame = None  # reported where frames are inspected
        if frame is not None and last is not None and frame.scene == last.scene and frame.previous == last.token:
            steps.append((frame.token, (frame.timestamp_ns - last.timestamp_ns) * 1e-9))
        last = frame
    if not any(step for _, step in steps):
        return []
    usual = float(np.median([step for _, step in steps]))
    return [
        Finding(
            "warning",
            f"{step:.2f} s after the frame before, usually {usual:.2f} s",
            "frames are missing or disordered",
            token,
            "time",
        )
        for token, step in steps
        if step <= 0 or step > 1.8 * usual
    ]
