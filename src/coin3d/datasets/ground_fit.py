"""Fit the ground plane under the vehicle to a LiDAR sweep."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from coin3d.geometry import GroundPlane

_NEAR_M, _FAR_M, _CELL_M = 3.0, 20.0, 1.0
_INLIER_M = 0.1
_TRIALS = 300
_MIN_CELLS = 30
_MAX_TILT_COS = np.cos(np.deg2rad(20.0))


@dataclass(frozen=True, eq=False)
class GroundFit:
    """A plane and how well it is supported.

    Args:
        plane: in the frame of the points.
        inlier_share: share of the ground cells within 0.1 m of the plane.
        points: number of points the final fit rests on.
    """

    plane: GroundPlane
    inlier_share: float
    points: int


def fit_ground(points_ego: Float[np.ndarray, "n 3"], origin_ego: Float[np.ndarray, "3"]) -> GroundFit | None:
    """Consensus plane through the lowest returns between 3 m and 20 m of the sensor, or None if there are too few.

    The lowest return of every 1 m cell votes, so that dense walls and vehicles do not. Planes steeper than 20 degrees
    to the ego's xy plane are not considered: the vehicle stands on what is found. Deterministic.

    Args:
        points_ego: metres, z up.
        origin_ego: where the sensor is; its plane must lie below it.
    """
    distance = np.linalg.norm(points_ego[:, :2] - origin_ego[:2], axis=1)
    below = points_ego[(distance > _NEAR_M) & (distance < _FAR_M) & (points_ego[:, 2] < origin_ego[2] - 0.3)]
    lowest = _lowest_per_cell(below)
    if len(lowest) < _MIN_CELLS:
        return None
    rng = np.random.default_rng(0)
    best, best_count = None, 0
    for _ in range(_TRIALS):
        plane = _plane_through(lowest[rng.choice(len(lowest), 3, replace=False)])
        if plane is not None:
            count = int((np.abs(plane.height_m(lowest)) < _INLIER_M).sum())
            if count > best_count:
                best, best_count = plane, count
    if best is None or best_count < _MIN_CELLS // 2:
        return None
    share = best_count / len(lowest)
    support = lowest
    # the lowest of many noisy returns lies a little low: the last round uses all points near the plane
    for support in (lowest, below, below):
        near = support[np.abs(best.height_m(support)) < _INLIER_M]
        refined = _plane_through(near)
        if refined is None:
            break
        best = refined
    return GroundFit(best, share, int((np.abs(best.height_m(support)) < _INLIER_M).sum()))


def _lowest_per_cell(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "m 3"]:
    order = np.argsort(points[:, 2])
    cells = np.floor(points[order, :2] / _CELL_M).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    return points[order[first]]


def _plane_through(points: Float[np.ndarray, "n 3"]) -> GroundPlane | None:
    """Least-squares plane, None where it is steep or not determined."""
    if len(points) < 3:
        return None
    centre = points.mean(0)
    _, spread, axes = np.linalg.svd(points - centre, full_matrices=False)
    normal = axes[2] * np.sign(axes[2, 2] or 1.0)
    if spread[1] < 1e-6 or normal[2] < _MAX_TILT_COS:
        return None
    return GroundPlane(normal, float(-normal @ centre))
