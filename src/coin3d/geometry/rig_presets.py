"""The rigs of the paper's data sets (supplement, table dataset_infos): idealised, pitch and roll 0."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coin3d.geometry.camera import Camera
from coin3d.geometry.pose import camera_pose
from coin3d.geometry.rig import Rig


@dataclass(frozen=True)
class _Mount:
    """One row of the table: name, position (x, y, z) in metres, yaw in degrees, focal length and image size in pixels.

    ``rows_cut`` are missing at the top of an image whose principal point was its centre before.
    """

    name: str
    position_m: tuple[float, float, float]
    yaw_deg: float
    focal_px: float
    size_px: tuple[int, int]
    rows_cut: int = 0

    def camera(self) -> Camera:
        width, height = self.size_px
        K = np.array([[self.focal_px, 0, width / 2], [0, self.focal_px, (height - self.rows_cut) / 2], [0, 0, 1]])
        return Camera(K, width, height, camera_pose(self.position_m, np.deg2rad(self.yaw_deg)))


def _nuscenes() -> list[_Mount]:
    size = (1600, 900)
    return [
        _Mount("CAM_FRONT", (1.7, 0.0, 1.5), 0, 1250, size),
        _Mount("CAM_FRONT_LEFT", (1.55, 0.5, 1.5), 55, 1250, size),
        _Mount("CAM_FRONT_RIGHT", (1.55, -0.5, 1.5), -55, 1250, size),
        _Mount("CAM_BACK", (0.0, 0.0, 1.5), 180, 800, size),
        _Mount("CAM_BACK_LEFT", (1.0, 0.5, 1.55), 110, 1250, size),
        _Mount("CAM_BACK_RIGHT", (1.0, -0.5, 1.55), -110, 1250, size),
    ]


def _lyft(size: tuple[int, int], focal: float, front_height: float) -> list[_Mount]:
    return [
        _Mount("CAM_FRONT", (1.5, 0.0, front_height), 0, focal, size),
        _Mount("CAM_FRONT_LEFT", (1.3, 0.3, front_height), 60, focal, size),
        _Mount("CAM_FRONT_RIGHT", (1.3, -0.3, front_height), -60, focal, size),
        _Mount("CAM_BACK", (0.8, 0.0, 1.65), 180, focal, size),
        _Mount("CAM_BACK_LEFT", (1.0, 0.3, 1.65), 120, focal, size),
        _Mount("CAM_BACK_RIGHT", (1.0, -0.3, 1.65), -120, focal, size),
    ]


def _waymo() -> list[_Mount]:
    # the side images are the lower 886 of 1280 rows: only so is their vertical FoV the table's 35 degrees
    front, side, cut = (1920, 1280), (1920, 886), 1280 - 886
    return [
        _Mount("FRONT", (1.55, 0.0, 2.1), 0, 2050, front),
        _Mount("FRONT_LEFT", (1.5, 0.1, 2.1), 45, 2050, front),
        _Mount("FRONT_RIGHT", (1.5, -0.1, 2.1), -45, 2050, front),
        _Mount("SIDE_LEFT", (1.4, 0.1, 2.1), 90, 2050, side, cut),
        _Mount("SIDE_RIGHT", (1.4, -0.1, 2.1), -90, 2050, side, cut),
    ]


RIG_PRESETS = {
    "nuscenes": _nuscenes,
    "lyft1": lambda: _lyft((1224, 1024), 880, 1.7),
    "lyft2": lambda: _lyft((1920, 1080), 1100, 1.65),
    "waymo": _waymo,
}
"""Name -> mounts; call ``preset_rig`` for the rig."""


def preset_rig(name: str, width_px: int | None = None) -> Rig:
    """A rig of the paper's table, optionally with all images scaled to ``width_px`` (K follows).

    Raises:
        ValueError: a name that is not a preset.
    """
    if name not in RIG_PRESETS:
        raise ValueError(f"no rig preset '{name}': there are {', '.join(RIG_PRESETS)}; or give the path of a rig.yaml")
    cameras = {m.name: m.camera() for m in RIG_PRESETS[name]()}
    if width_px is not None:
        cameras = {k: _scaled(c, width_px) for k, c in cameras.items()}
    return Rig(cameras, name=name)


def _scaled(camera: Camera, width_px: int) -> Camera:
    height_px = round(camera.height_px * width_px / camera.width_px)
    scale = np.diag([width_px / camera.width_px, height_px / camera.height_px, 1.0])
    return camera.transformed(scale, width_px, height_px)
