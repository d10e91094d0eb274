"""The four prior maps of every camera of a rig, rigs side by side on common colour scales."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, LogNorm, Normalize
from matplotlib.figure import Figure, SubFigure

from coin3d.geometry import Camera, GroundPlane, Rig
from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.priors import PriorOptions, prior_maps
from coin3d.priors.channels import DIRECTION, GROUND_DEPTH, GROUND_GRADIENT, INVERSE_FOCAL, MOMENT
from coin3d.priors.maps import GROUND_DEPTH_SCALE_M
from coin3d.rig_report.facts import at_network_input

DIRECTION_SCALE = 1.3
"""Direction components are drawn from -1.3 (dark) to 1.3 (bright)."""
MOMENT_SCALE_M = 2.6
"""Moment components are drawn from -2.6 m (dark) to 2.6 m (bright)."""

_SIZE_PX = (352, 192)
_NO_GROUND = "#dfe4ea"
_TITLES = ("inverse focal", "ground depth", "ground gradient", "Plücker direction", "Plücker moment")
_SCALES: tuple[tuple[Normalize, Colormap], ...] = (
    (Normalize(0, 2.2), colormaps["viridis"]),
    (LogNorm(2.5, PriorOptions().ground_cap_m), colormaps["turbo_r"]),
    (Normalize(0, 2.2), colormaps["magma"]),
)
_UNITS = ("(f_ref / f)²", "m", "log(1/g + 1) / 2")


def prior_maps_figure(rigs: Sequence[Rig]) -> Figure:
    """One row per camera, forward ones first so that rows of two rigs correspond; grey is where no ground is seen."""
    rows = max(len(rig) for rig in rigs)
    figure = Figure(figsize=(10.4 * len(rigs), 1.17 * rows + 1.3), layout="constrained")
    for half, rig in zip(figure.subfigures(1, len(rigs), squeeze=False, wspace=0.03)[0], rigs, strict=True):
        half.suptitle(f"{rig.name} ({_SIZE_PX[0]} x {_SIZE_PX[1]} network input)", fontsize=13)
        _draw_rig(half, rig, rows)
    return figure


def as_rgb(vectors: Float[np.ndarray, "... 3"], scale: float) -> Float[np.ndarray, "... 3"]:
    """Components x, y, z as red, green, blue; zero is middle grey."""
    return np.asarray(np.clip(0.5 + vectors / (2 * scale), 0, 1))


def _draw_rig(half: SubFigure, rig: Rig, rows: int) -> None:
    grid = half.subplots(rows + 1, len(_TITLES), squeeze=False, height_ratios=[*[1.0] * rows, 0.07])
    for axes in grid.flat:
        axes.set_axis_off()
    cameras = sorted(rig.items(), key=lambda item: (round(abs(item[1].yaw_rad), 2), -item[1].yaw_rad))
    for row, (name, camera) in zip(grid, cameras, strict=False):
        _draw_camera(row, camera, rig.ground)
        row[0].set_ylabel(name.replace("CAM_", "").replace("_", " ").lower(), fontsize=9)
    for axes, title in zip(grid[0], _TITLES, strict=True):
        axes.set_title(title, fontsize=11)
    for axes, (norm, cmap), unit in zip(grid[-1], _SCALES, _UNITS, strict=False):
        axes.set_axis_on()
        bar = half.colorbar(ScalarMappable(norm, cmap), cax=axes, orientation="horizontal")
        bar.set_label(unit, fontsize=8)
        bar.ax.tick_params(labelsize=7)
    grid[-1, 1].set_xticks([3, 5, 10, 20, 40, 60], labels=["3", "5", "10", "20", "40", "60"])
    grid[-1, 1].minorticks_off()
    for axes, limit in ((grid[-1, 3], f"±{DIRECTION_SCALE}"), (grid[-1, 4], f"±{MOMENT_SCALE_M} m")):
        axes.text(0.5, 0.5, f"x, y, z as RGB, {limit}", fontsize=8, ha="center", va="center")


def _draw_camera(row: Sequence[Axes], camera: Camera, ground: GroundPlane) -> None:
    small = at_network_input(camera, *_SIZE_PX)
    maps = prior_maps(CameraTensors.from_cameras([small], [ground]))[0].numpy()
    depth_m = np.where(maps[GROUND_DEPTH] > 0, maps[GROUND_DEPTH] * GROUND_DEPTH_SCALE_M, np.nan)
    gradient = np.where(maps[GROUND_GRADIENT] > 0, maps[GROUND_GRADIENT], np.nan)
    for axes, (norm, cmap), values in zip(row, _SCALES, (maps[INVERSE_FOCAL], depth_m, gradient), strict=False):
        axes.set_facecolor(_NO_GROUND)
        axes.imshow(values, cmap=cmap, norm=norm)
    value = float(maps[INVERSE_FOCAL, 0, 0])
    ink = "white" if value < 1.2 else "black"
    row[0].text(_SIZE_PX[0] / 2, _SIZE_PX[1] / 2, f"{value:.2f}", color=ink, fontsize=13, ha="center", va="center")
    row[3].imshow(as_rgb(np.moveaxis(maps[DIRECTION], 0, -1), DIRECTION_SCALE))
    row[4].imshow(as_rgb(np.moveaxis(maps[MOMENT], 0, -1), MOMENT_SCALE_M))
    for axes in row:
        axes.set_axis_on()
        axes.set(xticks=[], yticks=[])
