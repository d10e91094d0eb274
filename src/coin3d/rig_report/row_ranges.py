"""What training cameras saw of the ground in each image row: the ranges of inverse ground depth and inverse growth.

Both are the priors M_GD and M_GG before their fixed scales (docs/method.md) and without a pole at the horizon: with inverse
ground depth q = 1 / z, affine in the pixel, and b = dq/dv, growth is g = z(v - 1) - z(v), so 1 / g = q (q - b) / b. Where the
map is zero (no ground, or farther than the cap) both are 0 here. All in float64.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from coin3d.priors import PriorOptions
from coin3d.rig_report.training_views import SeenView

STRIDE_PX = 8
"""Cells of the network input: maps are compared at the centres of squares of this size."""

CAP_M = PriorOptions().ground_cap_m
"""Ground farther than this counts as none, as in the maps."""

RELATIVE_TOLERANCE = 0.05
"""Focal length, ground depth and ground gradient may be so much beyond a range before they count as outside."""


@dataclass(frozen=True, eq=False)
class RowRanges:
    """Smallest and largest value per row of cells, over all columns of all cameras.

    Args:
        depth: of 1 / z, in 1/m.
        growth: of 1 / g, in 1/m.
    """

    depth: tuple[Float[np.ndarray, "r"], Float[np.ndarray, "r"]]
    growth: tuple[Float[np.ndarray, "r"], Float[np.ndarray, "r"]]


def cell_centres(length_px: int) -> Float[np.ndarray, "n"]:
    """Centres of the cells along one side; those of whole cells, at least one."""
    count = max(1, length_px // STRIDE_PX)
    return (np.arange(count) + 0.5) * min(STRIDE_PX, length_px)


def inverse_depth_slope(view: SeenView) -> Float[np.ndarray, "3"]:
    """Three numbers s with 1 / z = s . [u, v, 1], before the cap (docs/method.md, ground depth); s[1] is the change per row."""
    n, camera = view.ground.normal, view.camera
    return np.asarray(-(n @ camera.ego_from_cam.rotation @ np.linalg.inv(camera.K)) / view.height_m)


def inverse_maps(
    view: SeenView, u_px: Float[np.ndarray, "c"], v_px: Float[np.ndarray, "r"]
) -> tuple[Float[np.ndarray, "r c"], Float[np.ndarray, "r c"]]:
    """1 / z and 1 / g at columns and rows; 0 where the maps are."""
    if view.height_m <= 0:
        return np.zeros((len(v_px), len(u_px))), np.zeros((len(v_px), len(u_px)))
    slope = inverse_depth_slope(view)
    q = slope[0] * u_px[None, :] + slope[1] * v_px[:, None] + slope[2]
    per_row = slope[1]
    depth = np.where(q >= 1 / CAP_M, q, 0.0)
    if per_row <= 0:
        return depth, np.zeros_like(depth)
    return depth, np.where(q - per_row >= 1 / CAP_M, q * (q - per_row) / per_row, 0.0)


def row_ranges(views: Sequence[SeenView]) -> RowRanges:
    """Over cameras of one image size. Along a row both values are monotone: the first and the last column are enough."""
    width_px, height_px = views[0].camera.width_px, views[0].camera.height_px
    ends, rows = cell_centres(width_px)[[0, -1]], cell_centres(height_px)
    both = np.array([inverse_maps(view, ends, rows) for view in views])  # views x (depth, growth) x rows x ends
    low, high = both.min((0, 3)), both.max((0, 3))
    return RowRanges((low[0], high[0]), (low[1], high[1]))


def outside_range(
    values: Float[np.ndarray, "r c"], low: Float[np.ndarray, "r"], high: Float[np.ndarray, "r"]
) -> Bool[np.ndarray, "r c"]:
    """Which inverse values lie outside the range of their row by more than the tolerance."""
    below = values * (1 + RELATIVE_TOLERANCE) < low[:, None]
    return np.asarray(below | (values > high[:, None] * (1 + RELATIVE_TOLERANCE)))
