"""The four settings in which the paper shows novel views, rendered and laid out on one sheet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, UInt8

from coin3d.drawing.sheet import Panel, sheet
from coin3d.geometry import Camera, Rig
from coin3d.geometry.rig_changes import full_overlap, raised
from coin3d.rendering.cpu import PreparedGaussians, render_cpu
from coin3d.rendering.view import Rendering

_TILE_PX = 320


@dataclass(frozen=True, eq=False)
class RenderedRig:
    """All images of one rig.

    Args:
        rig: the rig.
        renderings: by camera, in the order of the rig.
    """

    rig: Rig
    renderings: Mapping[str, Rendering]

    @property
    def empty_below_horizon(self) -> float:
        """Share of the pixels whose ray meets the ground that no Gaussian covers by half."""
        below = np.concatenate([_meets_ground(self.rig, camera).ravel() for camera in self.rig.values()])
        empty = np.concatenate([(self.renderings[name].alpha < 0.5).ravel() for name in self.rig])
        return float(empty[below].mean()) if below.any() else 0.0


def paper_settings(rig: Rig, step_m: float = 1.0) -> dict[str, Rig]:
    """Setting -> rig: the rig itself, a ring of full overlap, every camera higher and lower (paper supplement).

    Where a camera stands too low to go down by ``step_m``, the last setting is left out.
    """
    found = {"raw": rig, "full overlap 120 / 60 deg": full_overlap(rig), f"height +{step_m:g} m": raised(rig, step_m)}
    if min(rig.ground.height_m(c.ego_from_cam.translation) for c in rig.values()) > step_m + 0.05:
        found[f"height -{step_m:g} m"] = raised(rig, -step_m)
    return found


def render_rig(gaussians: PreparedGaussians, rig: Rig, threads: int = 1) -> RenderedRig:
    """Every camera of a rig.

    Raises:
        ValueError: a camera that is no pinhole.
    """
    images = render_cpu(gaussians, list(rig.values()), threads=threads)
    return RenderedRig(rig, dict(zip(rig, images, strict=True)))


def settings_sheet(rendered: Mapping[str, RenderedRig], title: str = "") -> UInt8[np.ndarray, "h w 3"]:
    """One row per setting, one picture per camera."""
    columns = max(len(one.renderings) for one in rendered.values())
    panels = []
    for setting, one in rendered.items():
        row = [Panel(image.rgb, f"{setting}: {name}") for name, image in one.renderings.items()]
        panels += row + [Panel(np.zeros_like(row[0].image), "")] * (columns - len(row))
    return sheet(panels, columns, _TILE_PX, title)


def _meets_ground(rig: Rig, camera: Camera) -> Bool[np.ndarray, "h w"]:
    falling: np.ndarray = camera.rays_ego(camera.pixel_grid()) @ rig.ground.normal < 0
    return falling
