"""Pictures of one rig or of several side by side."""

from __future__ import annotations

import io
from collections.abc import Sequence
from itertools import cycle

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Wedge

from coin3d.geometry import Camera, Rig
from coin3d.rig_report.facts import INPUT_WIDTH_PX, at_network_input, coverage_azimuths_rad, ground_profile, seen_by

RIG_COLOURS = ("#1f77b4", "#d1495b")
_VIEW_M = 22.0
_RIM_M = 21.2
_LABEL_BOX = {"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 1.5}


def figure_png(figure: Figure) -> bytes:
    """The encoded picture."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110, facecolor="white")
    return buffer.getvalue()


def top_view_figure(rigs: Sequence[Rig]) -> Figure:
    """Where cameras sit and look; around the rim, how many cameras see each direction."""
    figure = Figure(figsize=(8.2 * len(rigs), 8.6), layout="constrained")
    for axes, rig, colour in zip(figure.subplots(1, len(rigs), squeeze=False)[0], rigs, cycle(RIG_COLOURS), strict=False):
        _draw_top_view(axes, rig, colour)
    return figure


def _draw_top_view(axes: Axes, rig: Rig, colour: str) -> None:
    for ring_m in (5, 10, 15):
        axes.add_patch(Circle((0, 0), ring_m, fill=False, edgecolor="#d0d0d0", linewidth=1, zorder=0))
        place = ring_m * np.array([np.sin(np.deg2rad(150)), np.cos(np.deg2rad(150))])
        axes.text(place[0], place[1], f"{ring_m} m", fontsize=7, color="#8a8a8a", ha="center", va="center", bbox=_LABEL_BOX)
    # plot x = right = -ego y, plot y = forward = ego x; the vehicle's rear axle is the origin
    car = np.array([[-0.95, -1.0], [0.95, -1.0], [0.95, 3.2], [0.6, 3.75], [-0.6, 3.75], [-0.95, 3.2]])
    axes.add_patch(Polygon(car, closed=True, facecolor="#eeeeee", edgecolor="#777777", linewidth=1, zorder=2))
    for name, camera in rig.items():
        origin = camera.ego_from_cam.translation
        edges = camera.rays_ego(np.array([[u, camera.height_px / 2] for u in np.linspace(0, camera.width_px, 33)]))[:, :2]
        reach = _until(origin[:2], edges / np.linalg.norm(edges, axis=1, keepdims=True), 19.0)
        outline = np.concatenate([origin[None, :2], reach])
        axes.add_patch(Polygon(_plot(outline), closed=True, facecolor=colour, edgecolor=colour, alpha=0.16, zorder=1))
        axes.add_patch(Polygon(_plot(outline), closed=True, fill=False, edgecolor=colour, linewidth=1.1, zorder=3))
        axes.plot(*_plot(origin[None, :2])[0], "o", color=colour, markersize=4, zorder=4)
        middle = _plot(_until(origin[:2], np.array([[np.cos(camera.yaw_rad), np.sin(camera.yaw_rad)]]), 14.0))[0]
        label = f"{name}\n{np.rad2deg(camera.yaw_rad):+.0f}°, f {camera.focal_px:.0f} px\n{camera.height_m:.2f} m high"
        axes.text(middle[0], middle[1], label, fontsize=8, ha="center", va="center", zorder=5, bbox=_LABEL_BOX)
    azimuth_deg, count = np.rad2deg(coverage_azimuths_rad()), seen_by(rig)
    shades = {0: "#ffffff", 1: "#b9d7b0", 2: "#4f9d4a"}
    half_step = (azimuth_deg[1] - azimuth_deg[0]) / 2
    steps = np.flatnonzero(np.diff(count)) + 1
    for start, stop in zip([0, *steps], [*steps, len(count)], strict=True):
        shade = shades[min(int(count[start]), 2)]
        lower, upper = 90 + azimuth_deg[start] - half_step, 90 + azimuth_deg[stop - 1] + half_step
        axes.add_patch(Wedge((0, 0), _RIM_M, lower, upper, width=1.1, facecolor=shade, edgecolor=shade, linewidth=0.5))
    for radius_m in (_RIM_M, _RIM_M - 1.1):
        axes.add_patch(Circle((0, 0), radius_m, fill=False, edgecolor="#888888", linewidth=0.8))
    axes.set(xlim=(-_VIEW_M, _VIEW_M), ylim=(-_VIEW_M, _VIEW_M), aspect="equal", xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set_visible(False)
    seen, twice = (count >= 1).mean() * 360, (count >= 2).mean() * 360
    axes.set_title(f"{rig.name}: {len(rig)} cameras, {seen:.0f}° seen, {twice:.0f}° by two or more", fontsize=12)
    axes.annotate(
        "forward is up; rim: white no camera, light green one, dark green two or more",
        (0, -_VIEW_M + 0.2), fontsize=8, color="#555555", ha="center",
    )  # fmt: skip


def _plot(xy_ego: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    return np.stack([-xy_ego[:, 1], xy_ego[:, 0]], axis=1)


def _until(origin: Float[np.ndarray, "2"], directions: Float[np.ndarray, "n 2"], radius_m: float) -> Float[np.ndarray, "n 2"]:
    """Where rays from a point inside a circle about the ego meet the circle."""
    along = directions @ origin
    distance = -along + np.sqrt(np.maximum(along**2 - origin @ origin + radius_m**2, 0))
    return np.asarray(origin + distance[:, None] * directions)


def ground_growth_figure(rigs: Sequence[Rig]) -> Figure:
    """Ground depth against image row, and its growth per row against depth (paper figure prior-explanation b)."""
    figure = Figure(figsize=(13, 5.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    rows_shown = 260
    for rig, colour in zip(rigs, cycle(RIG_COLOURS), strict=False):
        styles = cycle(("-", "--", ":", "-."))
        for label, camera in _distinct_curves(rig).items():
            at_top, per_row = ground_profile(camera, rig.ground)
            if per_row <= 0:  # looks straight down or hangs upside down: no horizon to count rows from
                continue
            horizon = -at_top / per_row
            below = np.arange(1.0, rows_shown)
            visible = (horizon + below >= 0) & (horizon + below <= camera.height_px)
            depth = 1 / (per_row * below)
            style = next(styles)
            text = f"{rig.name}: {label}"
            left.plot(below, depth, color=colour, linestyle=style, alpha=0.25, linewidth=1.2)
            left.plot(below[visible], depth[visible], color=colour, linestyle=style, linewidth=2, label=text)
            if visible.any() and visible.sum() < len(below):
                left.plot(below[visible][-1], depth[visible][-1], "o", color=colour, markersize=5)
            reach = np.linspace(max(depth[visible].min(initial=60.0), 2.0), 60, 300)
            growth = per_row * reach**2 / (1 - per_row * reach)
            right.plot(reach, growth, color=colour, linestyle=style, linewidth=2, label=text)
    left.set(xlim=(0, rows_shown), ylim=(0, 60), ylabel="ground depth (m)")
    left.set_xlabel(f"image rows below the horizon ({INPUT_WIDTH_PX} px wide input)")
    left.set_title("ground depth; a dot marks the lower edge of the image", fontsize=11)
    right.set(xlim=(0, 60), ylim=(0, None), xlabel="ground depth (m)", ylabel="growth to the next row up (m)")
    right.set_title("the higher the camera and the longer its lens, the slower the growth", fontsize=11)
    for axes in (left, right):
        axes.grid(color="#e5e5e5")
        axes.legend(fontsize=8)
    return figure


def _distinct_curves(rig: Rig) -> dict[str, Camera]:
    """One camera at network input per height and focal length, named by how many share them."""
    groups: dict[tuple[float, float], list[tuple[str, Camera]]] = {}
    for name, camera in rig.items():
        small = at_network_input(camera)
        height_m = float(rig.ground.height_m(camera.ego_from_cam.translation))
        groups.setdefault((round(height_m, 2), round(small.focal_px, -1)), []).append((name, small))
    curves = {}
    for (height_m, _), members in groups.items():
        name, camera = members[0]
        who = name if len(members) == 1 else f"{name} and {len(members) - 1} more"
        curves[f"{who}, {height_m:.2f} m high, f {camera.focal_px:.0f} px"] = camera
    return curves
