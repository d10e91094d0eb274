"""Pictures of the distance of a rig to a training: numbers against ranges, ground by image row, where rays point."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import cycle

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from coin3d.geometry import Rig
from coin3d.rig_report.prior_distance import (
    HEIGHT_TOLERANCE_M,
    PITCH_TOLERANCE_DEG,
    ROLL_TOLERANCE_DEG,
    CameraDistance,
    RigDistance,
    Span,
)
from coin3d.rig_report.ray_coverage import sees_direction
from coin3d.rig_report.ring import border_degrees
from coin3d.rig_report.row_ranges import CAP_M, RELATIVE_TOLERANCE, cell_centres, inverse_maps, outside_range, row_ranges
from coin3d.rig_report.training_views import SeenView, TrainingViews, network_view

RECORDED, SHOWN = "#8fb3d9", "#d9e6f3"
"""Colours of what the training recordings had, and of what augmentation added."""
_INSIDE, _OUTSIDE = "#2e8b57", "#c23b22"
_LINES = ("#1f2937", "#c23b22", "#2e8b57", "#8a4fbf", "#c77700", "#0e7c86", "#b0357a", "#5b6472")
_ELEVATION_DEG = 60.0
_STEP_DEG = 1.0
_DEPTH_AXIS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, CAP_M)
_GROWTH_AXIS = (0.001, 0.01, 0.1, 1.0, 10.0)
_BEYOND_ALL = 1e3


@dataclass(frozen=True)
class _Column:
    """One panel of the picture of numbers.

    Args:
        title: over it.
        of: the number of a camera.
        narrowest: least width of the axis.
        tolerance: how far outside a dot may be and still count as within.
        relative: whether the tolerance is a share of the number.
    """

    title: str
    of: Callable[[CameraDistance], Span]
    narrowest: float
    tolerance: float
    relative: bool = False


_COLUMNS = (
    _Column("focal length (px)", lambda c: c.focal_px, 100, RELATIVE_TOLERANCE, True),
    _Column("ground growth\nper row at 20 m (m)", lambda c: c.growth_m, 0.2, RELATIVE_TOLERANCE, True),
    _Column("height (m)", lambda c: c.height_m, 0.6, HEIGHT_TOLERANCE_M),
    _Column("pitch (°, down +)", lambda c: c.pitch_deg, 8, PITCH_TOLERANCE_DEG),
    _Column("roll (°)", lambda c: c.roll_deg, 8, ROLL_TOLERANCE_DEG),
    _Column("field of view (°)", lambda c: c.fov_deg, 10, RELATIVE_TOLERANCE, True),
)


def numbers_figure(distance: RigDistance) -> Figure:
    """A column per number and a row per camera: bands of training, dots of the rig, red where outside."""
    cameras = list(distance.shown)
    figure = Figure(figsize=(15, 0.42 * len(cameras) + 2.1), layout="constrained")
    for axes, column in zip(figure.subplots(1, len(_COLUMNS), sharey=True), _COLUMNS, strict=True):
        recorded, shown = column.of(distance.recorded[0]), column.of(cameras[0])
        _band(axes, shown, SHOWN)
        _band(axes, recorded, RECORDED)
        for row, camera in enumerate(cameras):
            _dot(axes, column.of(camera), row, column)
        axes.set_title(column.title, fontsize=11)
        axes.set(ylim=(len(cameras) - 0.4, -0.6), yticks=range(len(cameras)), yticklabels=[c.name for c in cameras])
        axes.margins(x=0.12)
        axes.xaxis.set_major_locator(MaxNLocator(4))
        low, high = axes.get_xlim()
        spread = max(0.0, column.narrowest - (high - low)) / 2
        axes.set_xlim(low - spread, high + spread)
        axes.grid(axis="y", color="#e5e5e5")
    figure.legend(handles=_legend(distance), loc="outside lower center", ncols=4, fontsize=9, frameon=False)
    return figure


def rows_figure(rig: Rig, distance: RigDistance, views: TrainingViews) -> Figure:
    """Ground depth and its growth against the image row, one pair of panels per camera."""
    recorded, shown = row_ranges(views.recorded), row_ranges(views.everything)
    lines = -(-len(rig) // 4)
    columns = -(-len(rig) // lines)
    figure = Figure(figsize=(4.1 * columns + 0.6, 5.2 * lines + 0.8), layout="constrained")
    grid = figure.subplots(2 * lines, columns, squeeze=False, sharey=True)
    for axes in grid.flat:
        axes.set_axis_off()
    rows = cell_centres(distance.size_px[1])
    for place, (name, camera) in enumerate(rig.items()):
        line, column = divmod(place, columns)
        view = network_view(camera, rig.ground, distance.size_px)
        middle = np.array([distance.size_px[0] / 2])
        for axes, values, wide, narrow, label in zip(
            grid[2 * line : 2 * line + 2, column],
            inverse_maps(view, middle, rows),
            (shown.depth, shown.growth),
            (recorded.depth, recorded.growth),
            ("ground depth (m)", "growth to the next row up (m)"),
            strict=True,
        ):
            axis = _DEPTH_AXIS if label.startswith("ground") else _GROWTH_AXIS
            axes.set_axis_on()
            _row_band(axes, rows, wide, SHOWN)
            _row_band(axes, rows, narrow, RECORDED)
            depth = _upright(values[:, 0])
            axes.plot(depth, rows, color=_LINES[0], linewidth=2)
            outside = outside_range(values, *wide)[:, 0]
            if outside.any():  # dots that are not clipped need a place: those of an empty line would be at the figure's corner
                at_edge = np.clip(np.nan_to_num(depth, nan=axis[-1]), axis[0], axis[-1])  # right edge: no ground
                axes.plot(at_edge[outside], rows[outside], ".", color=_OUTSIDE, markersize=7, clip_on=False)
            axes.set(xscale="log", xlim=(axis[0], axis[-1]), ylim=(distance.size_px[1], 0), xlabel=label)
            axes.set_xticks(axis, labels=[f"{tick:g}" for tick in axis])
            axes.minorticks_off()
            axes.grid(color="#ececec")
        grid[2 * line, column].set_title(name, fontsize=11)
        if column == 0:
            for axes in grid[2 * line : 2 * line + 2, 0]:
                axes.set_ylabel("row of the network input")
    figure.legend(handles=_legend(distance, line=True), loc="outside lower center", ncols=columns, fontsize=9, frameon=False)
    return figure


def directions_figure(rig: Rig, distance: RigDistance, views: TrainingViews) -> Figure:
    """All directions around the vehicle: where training looked, and the images of the rig drawn over it."""
    figure = Figure(figsize=(15, 6.2), layout="constrained")
    axes = figure.subplots()
    azimuth, elevation = np.arange(180, -180, -_STEP_DEG), np.arange(_ELEVATION_DEG, -_ELEVATION_DEG, -_STEP_DEG)
    looks = _unit(*np.meshgrid(np.deg2rad(azimuth), np.deg2rad(elevation)))
    picture = np.ones((*looks.shape[:2], 3))
    for seen, colour in ((views.everything, SHOWN), (views.recorded, RECORDED)):
        picture[_looked_at(seen, looks)] = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    axes.imshow(picture, extent=(180, -180, -_ELEVATION_DEG, _ELEVATION_DEG), aspect="auto", interpolation="nearest")
    for (name, camera), colour in zip(rig.items(), cycle(_LINES), strict=False):
        azimuths, elevations = border_degrees(network_view(camera, rig.ground, distance.size_px).camera)
        for turn in (-360, 0, 360):
            axes.plot(azimuths + turn, elevations, color=colour, linewidth=1.8)
        middle = float(np.rad2deg(camera.yaw_rad))
        side = "left" if middle > 165 else "right" if middle < -165 else "center"
        top = float(np.clip(elevations.max(), -_ELEVATION_DEG, _ELEVATION_DEG - 5))
        axes.text(middle, top + 1, name, fontsize=9, color=colour, ha=side, va="bottom", clip_on=True)
    axes.set(xlim=(180, -180), ylim=(-_ELEVATION_DEG, _ELEVATION_DEG), xticks=range(-180, 181, 45))
    axes.set(xlabel="azimuth (°; left of the vehicle to the left)", ylabel="elevation (°)")
    axes.grid(color="#ececec")
    kinds = [Patch(color=RECORDED, label="a training camera looked here"), Patch(fc="white", ec="#999999", label="none did")]
    if distance.augmented:
        kinds.insert(1, Patch(color=SHOWN, label="augmentation looked here"))
    axes.legend(handles=kinds, loc="lower right", fontsize=9)
    return figure


def _band(axes: Axes, span: Span, colour: str) -> None:
    if span.low is not None and span.high is not None:
        # a single camera has a range without width, which would not show
        axes.axvspan(span.low, span.high, facecolor=colour, edgecolor=colour, linewidth=3, zorder=0)


def _dot(axes: Axes, span: Span, row: int, column: _Column) -> None:
    if span.value is None:
        axes.text(0.5, row, "none", fontsize=8, color=_OUTSIDE, ha="center", va="center", transform=axes.get_yaxis_transform())
        return
    margin = column.tolerance * (abs(span.value) if column.relative else 1.0)
    inside = span.beyond is not None and abs(span.beyond) <= margin
    axes.plot(span.value, row, "o", color=_INSIDE if inside else _OUTSIDE, markersize=7)


def _row_band(axes: Axes, rows: Float[np.ndarray, "r"], limits: tuple[np.ndarray, np.ndarray], colour: str) -> None:
    low, high = limits
    near, far = _upright(high), np.where(high > 0, np.nan_to_num(_upright(low), nan=_BEYOND_ALL), np.nan)
    axes.fill_betweenx(rows, near, far, facecolor=colour, edgecolor=colour, linewidth=2)


def _upright(inverse: Float[np.ndarray, "r"]) -> Float[np.ndarray, "r"]:
    """1 / x, not a number where x is 0."""
    with np.errstate(divide="ignore"):
        return np.where(inverse > 0, 1 / inverse, np.nan)


def _legend(distance: RigDistance, line: bool = False) -> list[Patch]:
    names = ", ".join(distance.trained_on[:3]) + (" ..." if len(distance.trained_on) > 3 else "")
    kinds = [Patch(color=RECORDED, label=f"cameras of the training ({names})")]
    if distance.augmented:
        kinds.append(Patch(color=SHOWN, label="what augmentation made of them"))
    inside = Patch(color=_LINES[0] if line else _INSIDE, label=f"{distance.rig}" if line else f"{distance.rig}, within")
    return [*kinds, inside, Patch(color=_OUTSIDE, label=f"{distance.rig}, outside")]


def _looked_at(views: Sequence[SeenView], looks: Float[np.ndarray, "h w 3"]) -> np.ndarray:
    flat = looks.reshape(-1, 3)
    seen = np.zeros(len(flat), dtype=bool)
    for view in views:
        if view.filled:
            seen |= sees_direction(view.camera, flat)
    return seen.reshape(looks.shape[:2])


def _unit(azimuth: Float[np.ndarray, "h w"], elevation: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w 3"]:
    flat = np.cos(elevation)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=-1)
