"""Do sweeps of neighbouring frames lie on each other, by the ego poses? What stands still must.

Where a vehicle drives towards its own -x axis of the world, inverted poses let it drive ahead just as well: its moves alone
(``motion_checks``) do not tell, walls and poles at the roadside do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from coin3d.check.finding import Finding
from coin3d.check.frame_checks import FrameReport
from coin3d.datasets.frame import Frame, LidarScan
from coin3d.geometry import Pose, Rig

_HEIGHT_M = (0.4, 4.0)  # asphalt lies on asphalt however a vehicle has moved
_RANGE_M = 35.0
_SAME_PLACE_M = 0.3
_MIN_POINTS = 200
_BETTER, _GOOD_SHARE = 1.3, 0.3
_HARDLY_ANY = 0.1  # on a motorway most of what is near may drive along, but not all


def sweep_findings(reports: Sequence[FrameReport], neighbours: Mapping[str, Mapping[str, Frame]]) -> list[Finding]:
    """Ego poses by which less of two sweeps lies on each other than by another reading of them.

    Args:
        reports: inspected frames.
        neighbours: token -> "before" and "after" -> frame, where there are such.
    """
    shares = np.array([found for report in reports for found in _shares(report, neighbours.get(report.frame.token, {}))])
    if not len(shares):
        return []
    given, inverted, still = np.median(shares, axis=0)
    best, reading = inverted, "with the poses inverted"
    if given < _HARDLY_ANY and still > inverted:
        best, reading = still, "if the vehicle had not moved at all"
    if best < _GOOD_SHARE or best < _BETTER * given:
        return []
    return [
        Finding(
            "error",
            f"by its poses {given:.0%} of a sweep lie on that of the next frame, and {best:.0%} {reading} "
            f"(median of {len(shares)} pairs of frames)",
            "ego poses are world_from_ego in metres, at the time of the frame, in the axes that the LiDAR is told in",
            about="poses",
        )
    ]


def _shares(report: FrameReport, around: Mapping[str, Frame]) -> list[tuple[float, float, float]]:
    """Share of this frame's points that lie on a neighbour's: as given, inverted, without a move."""
    if report.scan is None:
        return []
    now = report.frame
    mine = _standing(report.scan, now.rig)
    found = []
    for frame in around.values():
        scan = _scan_of(frame)
        theirs = _standing(scan, frame.rig) if scan is not None else mine[:0]
        if min(len(mine), len(theirs)) < _MIN_POINTS:
            continue
        tree = cKDTree(theirs)
        given = frame.world_from_ego.inverse() @ now.world_from_ego
        inverted = frame.world_from_ego @ now.world_from_ego.inverse()
        found.append((_on(tree, given, mine), _on(tree, inverted, mine), _on(tree, Pose.identity(), mine)))
    return found


def _scan_of(frame: Frame) -> LidarScan | None:
    try:
        return None if frame.lidar is None else frame.lidar.load()
    except ValueError:
        return None  # reported where that frame is inspected


def _standing(scan: LidarScan, rig: Rig) -> Float[np.ndarray, "n 3"]:
    """Points near the vehicle that are not on the ground."""
    points = scan.points_ego
    height_m = rig.ground.height_m(points)
    near = np.linalg.norm(points[:, :2], axis=1) < _RANGE_M
    return np.asarray(points[near & (height_m > _HEIGHT_M[0]) & (height_m < _HEIGHT_M[1])])


def _on(tree: cKDTree, there_from_here: Pose, points: Float[np.ndarray, "n 3"]) -> float:
    distance_m, _ = tree.query(there_from_here.apply(points), distance_upper_bound=_SAME_PLACE_M)
    return float(np.isfinite(distance_m).mean())
