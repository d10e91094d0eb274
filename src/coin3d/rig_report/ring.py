"""The Plücker ring: every camera of a rig placed in one panorama around the vehicle (paper figure prior-explanation c)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from coin3d.geometry import Camera, Rig
from coin3d.rig_report.map_figure import DIRECTION_SCALE, MOMENT_SCALE_M, as_rgb

_ELEVATION_DEG = 40.0
_STEP_DEG = 0.25
_COMPONENTS = (("x", "#c23b22"), ("y", "#2e8b57"), ("z", "#3456b0"))


def pluecker_ring_figure(rigs: Sequence[Rig]) -> Figure:
    """Direction and moment in a panorama per rig, and along the horizon as curves: one per camera and component."""
    figure = Figure(figsize=(10.5 * len(rigs), 10.2), layout="constrained")
    grid = figure.subplots(4, len(rigs), squeeze=False, height_ratios=(2, 2, 1.5, 1.5), sharex=True)
    for column, rig in zip(grid.T, rigs, strict=True):
        directions, moments = _panorama(rig)
        _draw_panorama(column[0], rig, as_rgb(directions, DIRECTION_SCALE))
        _draw_panorama(column[1], rig, as_rgb(moments, MOMENT_SCALE_M))
        column[0].set_title(f"{rig.name}: direction d = R K⁻¹ [u, v, 1]   (x, y, z as red, green, blue)", fontsize=11)
        column[1].set_title(r"moment $t \times d$", fontsize=11)
        _draw_curves(column[2], rig, moment=False)
        _draw_curves(column[3], rig, moment=True)
        column[2].set_title("direction along the horizon, one curve per camera", fontsize=11)
        column[3].set_title("moment along the horizon (m)", fontsize=11)
        column[3].set(xlabel="azimuth (degrees; left of the vehicle to the left)")
        column[3].set(xlim=(180, -180), xticks=range(-180, 181, 45))
    return figure


def _panorama(rig: Rig) -> tuple[Float[np.ndarray, "h w 3"], Float[np.ndarray, "h w 3"]]:
    """Direction and moment per viewing angle, from the camera looking nearest to it; NaN where no camera looks.

    Parallax does not matter here: a viewing angle stands for a point at infinity.
    """
    azimuth = np.deg2rad(np.arange(180, -180, -_STEP_DEG))
    elevation = np.deg2rad(np.arange(_ELEVATION_DEG, -_ELEVATION_DEG, -_STEP_DEG))
    flat = np.cos(elevation)[:, None]
    up = np.sin(elevation)[:, None] + 0 * azimuth
    looks = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), up], axis=-1)
    directions, moments = np.full(looks.shape, np.nan), np.full(looks.shape, np.nan)
    nearest = np.full(looks.shape[:2], -1.0)
    for camera in rig.values():
        forward = looks @ camera.ego_from_cam.rotation[:, 2]
        chosen = _sees_direction(camera, looks) & (forward > nearest)
        ray = looks[chosen] / forward[chosen][:, None]
        directions[chosen], moments[chosen] = ray, np.cross(camera.ego_from_cam.translation, ray)
        nearest[chosen] = forward[chosen]
    return directions, moments


def _sees_direction(camera: Camera, looks: Float[np.ndarray, "... 3"]) -> np.ndarray:
    return np.asarray(camera.sees(camera.ego_from_cam.translation + 1000.0 * looks))


def _draw_panorama(axes: Axes, rig: Rig, picture: Float[np.ndarray, "h w 3"]) -> None:
    picture = np.where(np.isnan(picture), 1.0, picture)
    extent = (180.0, -180.0, -_ELEVATION_DEG, _ELEVATION_DEG)
    axes.imshow(picture, extent=extent, aspect="auto", interpolation="nearest")
    for name, camera in rig.items():
        azimuth, elevation = border_degrees(camera)
        # a border that crosses the seam behind the vehicle is drawn on both sides of it
        for turn in (-360, 0, 360):
            axes.plot(azimuth + turn, elevation, color="black", linewidth=0.9)
            middle = float(np.rad2deg(camera.yaw_rad)) + turn
            if abs(middle) <= 180:
                label = name.replace("CAM_", "").replace("_", " ").lower()
                side = "right" if middle <= -170 else "left" if middle >= 170 else "center"
                axes.text(middle, _ELEVATION_DEG - 3, label, fontsize=8, ha=side, va="top")
    axes.set(ylim=(-_ELEVATION_DEG, _ELEVATION_DEG), yticks=(-30, 0, 30), ylabel="elevation")


def border_degrees(camera: Camera) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Azimuth (unwrapped) and elevation of the image border in degrees."""
    share = np.linspace(0, 1, 60)
    zero, one = np.zeros_like(share), np.ones_like(share)
    u, v = np.concatenate([share, one, 1 - share, zero]), np.concatenate([zero, share, one, 1 - share])
    rays = camera.rays_ego(np.stack([u * camera.width_px, v * camera.height_px], axis=-1))
    azimuth = np.rad2deg(np.unwrap(np.arctan2(rays[:, 1], rays[:, 0])))
    return azimuth, np.rad2deg(np.arctan2(rays[:, 2], np.hypot(rays[:, 0], rays[:, 1])))


def _draw_curves(axes: Axes, rig: Rig, moment: bool) -> None:
    azimuth_deg = np.arange(180, -180 - _STEP_DEG, -_STEP_DEG)
    azimuth = np.deg2rad(azimuth_deg)
    looks = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)], axis=-1)
    for camera in rig.values():
        forward = looks @ camera.ego_from_cam.rotation[:, 2]
        seen = _sees_direction(camera, looks)
        ray = np.where(seen[:, None], looks / np.where(seen, forward, 1.0)[:, None], np.nan)
        values = np.cross(camera.ego_from_cam.translation, ray) if moment else ray
        for component, (_, colour) in enumerate(_COMPONENTS):
            axes.plot(azimuth_deg, values[:, component], color=colour, linewidth=1.6)
    for name, colour in _COMPONENTS:
        axes.plot([], [], color=colour, label=name)
    limit = MOMENT_SCALE_M if moment else DIRECTION_SCALE
    axes.set(ylim=(-limit, limit))
    axes.grid(color="#e5e5e5")
    axes.legend(fontsize=8, ncols=3, loc="lower center")
