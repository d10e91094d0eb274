"""``coin3d town``: record towns through a rig and show what came out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from coin3d.datasets.frame import Frame
from coin3d.datasets.nuscenes_format import NuScenesRecording
from coin3d.drawing.sheet import Panel, save_png, sheet
from coin3d.drawing.top_view import top_view
from coin3d.geometry import RIG_PRESETS, Rig, load_rig, preset_rig
from coin3d.town.options import TownOptions
from coin3d.town.record import record


def town_command(
    out: Path,
    rig: str = "nuscenes",
    width: int = 400,
    scenes: int = 4,
    first_seed: int = 0,
    key_frames: int = 20,
    sweeps: bool = False,
    slope: bool = False,
    workers: int = 2,
    true_depth: bool = False,
    progress: Callable[[str], None] = print,
) -> Path:
    """Record a town in nuScenes format and write ``out/preview.png``.

    Args:
        out: folder of the recording; a repeated call goes on where it stopped.
        rig: name of a preset (nuscenes, lyft1, lyft2, waymo) or path of a rig.yaml.
        width: image width in pixels for presets; a rig file says its own sizes.
        scenes: number of towns, one scene each.
        first_seed: seed of the first town; the others follow.
        key_frames: annotated frames per scene, 0.5 s apart.
        sweeps: also store LiDAR sweeps at 10 Hz.
        slope: hilly ground.
        workers: processes.
        true_depth: also store depth images.
        progress: called with lines for the user.

    Returns:
        The preview picture.

    Raises:
        ValueError: an unknown rig or impossible numbers.
    """
    chosen = preset_rig(rig, width_px=width) if rig in RIG_PRESETS else load_rig(_rig_path(rig))
    seeds = list(range(first_seed, first_seed + scenes))
    record(
        chosen,
        Path(out),
        seeds,
        options=TownOptions(slope=slope),
        key_frames=key_frames,
        sweeps=sweeps,
        true_depth=true_depth,
        workers=workers,
        progress=progress,
    )
    recording = NuScenesRecording(out)
    frame = recording[min(len(recording) - 1, key_frames // 2)]
    return save_png(preview(frame), Path(out) / "preview.png")


def preview(frame: Frame) -> UInt8[np.ndarray, "h w 3"]:
    """All cameras of a frame as on the car, left to right and front before back, and the top view with boxes and LiDAR."""
    cameras = sorted(frame.rig, key=lambda name: (abs(frame.rig[name].yaw_rad) > 1.6, _across(frame.rig, name)))
    panels = [Panel(frame.image(name), name) for name in cameras]
    scan = frame.lidar.load() if frame.lidar is not None else None
    panels.append(
        Panel(top_view(frame.rig, frame.boxes, points_ego=None if scan is None else scan.points_ego), "top view, 50 m")
    )
    return sheet(panels, 3, 520, f"{frame.scene}, {len(frame.boxes or ())} boxes")


def _across(rig: Rig, name: str) -> float:
    """Sorts cameras of one half of the car by where they stand in a panorama seen from the driver's seat."""
    yaw = rig[name].yaw_rad
    return -yaw if abs(yaw) <= 1.6 else -float(np.sign(yaw) * (np.pi - abs(yaw)))


def _rig_path(rig: str) -> Path:
    path = Path(rig)
    if not path.is_file():
        raise ValueError(f"'{rig}' is neither a rig preset ({', '.join(RIG_PRESETS)}) nor the path of a rig file")
    return path
