"""How far the cameras of a rig are from those that a network was trained through, prior by prior.

A network reads four maps of a camera (docs/method.md). For each, this file says which share of the image cells holds a value
that training never showed, and how far it is from the nearest value that training did show, in a unit that means something on
the vehicle. It says nothing about how well a network copes with the difference. Cells are squares of ``STRIDE_PX`` of the
network input.

* **Inverse focal** is one number per camera. Distance: focal length over the nearest one of training, in network-input pixels.
* **Ground depth** is compared row by row: a network that knows the place of a cell expects there what it saw there. Training
  gives a range per row, over all columns of all its cameras; no ground counts as infinitely far. Distance: depth over the
  nearest depth of training in the same row, median over the cells where both see ground. Raising the only training camera from
  h to h' gives h' / h in every row.
* **Ground gradient** likewise; as distance serves the growth of ground depth per row where the ground is 20 m deep, which
  depends on focal length, height and lean alone, not on where the horizon lies.
* **Plücker rays**: the angle between a ray and the nearest direction in which training looked, and, where training did
  look, how far the ray passes from the parallel ray of the nearest training camera (``RayCoverage``).

A value counts as one that training did not show if it is farther from the range than the tolerances below, because a
range made of one camera has no width.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from coin3d.geometry import Rig, wrap_angle
from coin3d.geometry.undistort import undistorted_rig
from coin3d.rig_report.facts import GROWTH_AT_M
from coin3d.rig_report.ray_coverage import RayCoverage
from coin3d.rig_report.row_ranges import (
    RELATIVE_TOLERANCE,
    RowRanges,
    cell_centres,
    inverse_depth_slope,
    inverse_maps,
    outside_range,
    row_ranges,
)
from coin3d.rig_report.training_views import SeenView, network_view, training_views
from coin3d.training.seen_rigs import TrainingRigs

DIRECTION_TOLERANCE_DEG = 2.0
OFFSET_TOLERANCE_M = 0.25
HEIGHT_TOLERANCE_M = 0.1
PITCH_TOLERANCE_DEG = 2.0
ROLL_TOLERANCE_DEG = 5.0


@dataclass(frozen=True)
class Span:
    """A number of a camera, and the range of it in training.

    Args:
        value: of the camera; None where it has none.
        low: smallest in training; None where no training camera has one.
        high: largest in training.
    """

    value: float | None
    low: float | None
    high: float | None

    @property
    def nearest(self) -> float | None:
        """The value itself where training has it, else the end of the range that is nearest."""
        if self.value is None or self.low is None or self.high is None:
            return None
        return min(max(self.value, self.low), self.high)

    @property
    def beyond(self) -> float | None:
        """Value minus nearest: 0 within the range, negative below, positive above."""
        return None if self.value is None or self.nearest is None else self.value - self.nearest

    @property
    def ratio(self) -> float | None:
        """Value over nearest, of positive numbers: 1 within the range."""
        return None if self.value is None or self.nearest is None else self.value / self.nearest


@dataclass(frozen=True)
class CameraDistance:
    """One camera against everything that training showed; see the head of this file.

    Args:
        name: the camera.
        focal_px: focal length at network input.
        height_m: above the ground.
        pitch_deg: below the horizon.
        roll_deg: about the line of sight.
        fov_deg: horizontal field of view of the network input (2 arctan(c_u / f_u), as everywhere).
        growth_m: growth of ground depth to the next row up where it is 20 m, at network input; None where it does not grow
            upwards (a camera on its head) or jumps past the horizon.
        nearest_yaw_deg: turn from the training camera that looks most nearly the same way, positive to the left.
        focal_outside: share of cells whose inverse focal value training did not show: 0 or 1.
        depth_outside: the same for ground depth.
        growth_outside: the same for the ground gradient.
        direction_outside: share of cells whose ray points where no training camera looked.
        offset_outside: share of cells whose ray passes far from all rays of training with its direction, or has none such.
        depth_ratio: ground depth over the nearest of training in the same row; None if no cell has both.
        depth_beyond_m: ground depth minus the nearest of training in the same row, median of the same cells.
        direction_deg: largest angle between a ray and the directions in which training looked.
        offset_m: distance of rays from the nearest parallel ones of training, median over those that have any; else None.
    """

    name: str
    focal_px: Span
    height_m: Span
    pitch_deg: Span
    roll_deg: Span
    fov_deg: Span
    growth_m: Span
    nearest_yaw_deg: float
    focal_outside: float
    depth_outside: float
    growth_outside: float
    direction_outside: float
    offset_outside: float
    depth_ratio: float | None
    depth_beyond_m: float | None
    direction_deg: float
    offset_m: float | None


@dataclass(frozen=True)
class RigDistance:
    """A rig against the rigs of a training.

    Args:
        rig: name of the rig.
        size_px: (width, height) of the network input at which maps are compared.
        trained_on: names of the training rigs, each once.
        training_rigs: how many distinct ones there are.
        augmented: whether augmentation made more of them.
        recorded: each camera against the cameras of the training recordings alone.
        shown: each camera against those and what augmentation made of them; the same as ``recorded`` without augmentation.
    """

    rig: str
    size_px: tuple[int, int]
    trained_on: tuple[str, ...]
    training_rigs: int
    augmented: bool
    recorded: tuple[CameraDistance, ...]
    shown: tuple[CameraDistance, ...]


def rig_distance(rig: Rig, training: TrainingRigs) -> RigDistance:
    """Compare every camera of a rig with those of a training; pinhole cameras stand in for those with lenses."""
    rig = undistorted_rig(rig)
    views = training_views(training)
    mine = {name: network_view(camera, rig.ground, training.size_px) for name, camera in rig.items()}
    recorded = _distances(mine, views.recorded)
    return RigDistance(
        rig.name,
        training.size_px,
        tuple(dict.fromkeys(r.name for r in training.rigs)),
        len(training.rigs),
        bool(views.drawn),
        recorded,
        _distances(mine, views.everything) if views.drawn else recorded,
    )


def _distances(mine: dict[str, SeenView], theirs: Sequence[SeenView]) -> tuple[CameraDistance, ...]:
    rows, rays = row_ranges(theirs), RayCoverage(theirs)
    spans = {number: _range_of([number(view) for view in theirs]) for number in _NUMBERS}
    yaws_rad = np.array([view.camera.yaw_rad for view in theirs])
    found = []
    for name, view in mine.items():
        focal, height, pitch, roll, fov, growth = (Span(number(view), *spans[number]) for number in _NUMBERS)
        turns_deg = np.rad2deg(wrap_angle(view.camera.yaw_rad - yaws_rad))
        u_px, v_px = cell_centres(view.camera.width_px), cell_centres(view.camera.height_px)
        depth_outside, growth_outside, ratio, beyond_m = _ground(view, u_px, v_px, rows)
        angle_deg, offset_m = _rays(view, u_px, v_px, rays)
        far = ~(offset_m <= OFFSET_TOLERANCE_M)  # also where no ray was
        found.append(
            CameraDistance(
                name, focal, height, pitch, roll, fov, growth,
                float(turns_deg[np.argmin(np.abs(turns_deg))]) + 0.0,
                float(abs(np.log(focal.ratio or 1.0)) > np.log1p(RELATIVE_TOLERANCE)),
                depth_outside,
                growth_outside,
                float((angle_deg > DIRECTION_TOLERANCE_DEG).mean()),
                float(far.mean()),
                ratio,
                beyond_m,
                float(angle_deg.max()),
                None if np.isnan(offset_m).all() else float(np.nanmedian(offset_m)),
            )
        )  # fmt: skip
    return tuple(found)


def _ground(
    view: SeenView, u_px: Float[np.ndarray, "c"], v_px: Float[np.ndarray, "r"], rows: RowRanges
) -> tuple[float, float, float | None, float | None]:
    """Shares of cells outside for ground depth and gradient; ratio and metres of depth beyond the row's range."""
    depth, growth = inverse_maps(view, u_px, v_px)
    low, high = (limit[:, None] for limit in rows.depth)
    nearest = np.clip(depth, low, high)
    both = (depth > 0) & (nearest > 0)
    shares = [float(outside_range(depth, *rows.depth).mean()), float(outside_range(growth, *rows.growth).mean())]
    if not both.any():
        return shares[0], shares[1], None, None
    ratio = float(np.median(nearest[both] / depth[both]))
    return shares[0], shares[1], ratio, float(np.median(1 / depth[both] - 1 / nearest[both]))


def _rays(
    view: SeenView, u_px: Float[np.ndarray, "c"], v_px: Float[np.ndarray, "r"], rays: RayCoverage
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    pixels = np.stack(np.meshgrid(u_px, v_px), axis=-1).reshape(-1, 2)
    directions = view.camera.rays_ego(pixels)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return rays.distances(directions, view.camera.ego_from_cam.translation)


def _range_of(values: Sequence[float | None]) -> tuple[float | None, float | None]:
    known = [value for value in values if value is not None]
    return (min(known), max(known)) if known else (None, None)


def _focal_px(view: SeenView) -> float:
    return view.camera.focal_px


def _height_m(view: SeenView) -> float:
    return view.height_m


def _pitch_deg(view: SeenView) -> float:
    return float(np.rad2deg(-np.arcsin(np.clip(view.camera.ego_from_cam.rotation[2, 2], -1, 1))))


def _roll_deg(view: SeenView) -> float:
    right, down, _ = view.camera.ego_from_cam.rotation.T
    return float(np.rad2deg(np.arctan2(-right[2], -down[2])))


def _fov_deg(view: SeenView) -> float:
    return float(np.rad2deg(view.camera.fov_horizontal_rad))


def _growth_m(view: SeenView) -> float | None:
    """z(v - 1) - z(v) at z = 20 m: with b = dq/dv it is b / (q (q - b))."""
    q, per_row = 1 / GROWTH_AT_M, float(inverse_depth_slope(view)[1])
    return per_row / (q * (q - per_row)) if 0 < per_row < q else None


_NUMBERS: tuple[Callable[[SeenView], float | None], ...] = (_focal_px, _height_m, _pitch_deg, _roll_deg, _fov_deg, _growth_m)
