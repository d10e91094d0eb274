"""What the cameras of a rig cover together, by direction and distance: blind spots, overlaps, pixels per metre."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from coin3d.geometry import Rig

ABOVE_GROUND_M = 1.0
"""Points are looked for at this height: about that of the middle of a car or a person."""

DISTANCES_M = (2.0, 3.0, 5.0, 10.0, 20.0, 30.0, 50.0)
_STEP_DEG = 0.5
_REACH_M = 50.0
_CELL_M = 0.25
_RINGS_M = (5, 10, 20, 30, 40, 50)


@dataclass(frozen=True)
class Coverage:
    """One distance from the ego origin.

    Args:
        distance_m: radius of a circle of points, 1 m above the ground.
        seen_deg: how much of it at least one camera sees, of 360 degrees.
        overlapping_deg: how much of it two cameras or more see.
        pixels_per_metre: in recorded images, the least and the median over what is seen; None where nothing is.
    """

    distance_m: float
    seen_deg: float
    overlapping_deg: float
    pixels_per_metre: tuple[float, float] | None


def looked_at(rig: Rig, xy_m: Float[np.ndarray, "n 2"]) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Points 1 m above the ground: how many cameras see each, and the most pixels per metre of those that do.

    Pixels per metre are those of a metre across the line of sight, focal length over depth; 0 where no camera looks.
    """
    normal = rig.ground.normal
    ground_z = -(xy_m @ normal[:2] + rig.ground.offset_m) / normal[2]
    points = np.concatenate([xy_m, ground_z[:, None]], axis=1) + ABOVE_GROUND_M * normal
    count, density = np.zeros(len(points), dtype=np.int64), np.zeros(len(points))
    for camera in rig.values():
        pixels, depth_m = camera.project(points)
        seen = camera.in_image(pixels, depth_m)
        count += seen
        density[seen] = np.maximum(density[seen], camera.focal_px / depth_m[seen])
    return count, density


def coverage(rig: Rig) -> tuple[Coverage, ...]:
    """At each of ``DISTANCES_M``."""
    angle = np.deg2rad(np.arange(_STEP_DEG / 2, 360, _STEP_DEG))
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    found = []
    for distance_m in DISTANCES_M:
        count, density = looked_at(rig, distance_m * circle)
        seen = density[count > 0]
        pixels = (float(seen.min()), float(np.median(seen))) if len(seen) else None
        found.append(
            Coverage(distance_m, float((count > 0).mean() * 360), float((count > 1).mean() * 360), pixels),
        )
    return tuple(found)


def coverage_figure(rig: Rig) -> Figure:
    """From above: pixels per metre with blind spots left white, and how many cameras see each place."""
    side = np.arange(-_REACH_M + _CELL_M / 2, _REACH_M, _CELL_M)
    # rows go backwards from the front, columns from the left to the right: forward is up
    x, y = np.meshgrid(-side, -side, indexing="ij")
    count, density = (a.reshape(x.shape) for a in looked_at(rig, np.stack([x.ravel(), y.ravel()], axis=-1)))
    figure = Figure(figsize=(14, 6.9), layout="constrained")
    left, right = figure.subplots(1, 2)
    extent = (_REACH_M, -_REACH_M, -_REACH_M, _REACH_M)
    shown = left.imshow(np.where(count > 0, density, np.nan), norm=LogNorm(8, 512), cmap="viridis", extent=extent)
    bar = figure.colorbar(shown, ax=left, shrink=0.85, extend="both")
    bar.set_ticks([8, 16, 32, 64, 128, 256, 512], labels=["8", "16", "32", "64", "128", "256", "512"])
    bar.minorticks_off()
    left.set_title(f"pixels per metre {ABOVE_GROUND_M:g} m above the ground (white: no camera)", fontsize=11)
    colours = np.array([[1, 1, 1], [0.725, 0.843, 0.69], [0.31, 0.616, 0.29], [0.1, 0.36, 0.2]])
    right.imshow(colours[np.minimum(count, 3)], extent=extent)
    right.set_title("seen by no camera (white), one, two, three or more (dark)", fontsize=11)
    for axes in (left, right):
        for ring_m in _RINGS_M:
            axes.add_patch(Circle((0, 0), ring_m, fill=False, edgecolor="#444444", linewidth=0.6, alpha=0.6))
        axes.plot(0, 0, "+", color="#c23b22", markersize=9)
        axes.set(xlabel="left of the vehicle (m)", xlim=(_REACH_M, -_REACH_M), ylim=(-_REACH_M, _REACH_M), aspect="equal")
    left.set_ylabel("ahead of the vehicle (m)")
    return figure
