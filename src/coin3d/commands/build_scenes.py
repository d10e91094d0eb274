"""``coin3d build-scenes``: every annotated frame of a recording as 3D Gaussians."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from coin3d.commands.outcome import finish
from coin3d.commands.town import need_ray_casting


def build_scenes(
    recording: Annotated[Positional[Path], arg(metavar="RECORDING")],
    out: Path,
    width: Annotated[int, arg(metavar="PX")] = 800,
    workers: int = 2,
    keep_depth: bool = False,
) -> None:
    """Rebuild every annotated frame as 3D Gaussians, without any training, to be rendered through other rigs.

    Needs boxes with instance ids, LiDAR, and images; LiDAR sweeps between key frames make it better. Per scene it writes one
    file of Gaussians per key frame, the meshes, and a picture of every step. Called again it continues where it stopped.

    Try:
      coin3d town --out data/town --scenes 2 --sweeps
      coin3d build-scenes data/town --out data/town_scenes --width 400

    Args:
        recording: folder with nuScenes-format tables.
        out: folder for the scenes.
        width: images are shrunk to this width first; that of the training images, or 800 as in the paper.
        workers: processes.
        keep_depth: keep the depth of every image as well.
    """
    need_ray_casting()
    from coin3d.datasets.open import open_recording
    from coin3d.scenes.build import build_scenes as build
    from coin3d.scenes.options import BuildOptions
    from coin3d.scenes.work_files import SceneFiles

    outcome = build(open_recording(recording), out, BuildOptions(width_px=width, keep_depth=keep_depth), workers=workers)
    frames = outcome.frames
    mean = {name: sum(getattr(frame, name) for frame in frames) / len(frames) for name in _SHOWN}
    print(f"{len(frames)} frames of {len(outcome.scenes)} scenes in {outcome.elapsed_s:.0f} s")
    for step, seconds in outcome.seconds.items():
        print(f"  {step:<18}{seconds:8.1f} s of processor time")
    print(
        f"own images rendered with {mean['psnr_db']:.1f} dB, {mean['empty_below_horizon']:.2%} empty below the horizon; depth: "
        f"{mean['mesh']:.0%} meshes, {mean['lidar']:.0%} LiDAR, {mean['completed']:.0%} completed, {mean['sky']:.0%} sky"
    )
    for scene, reason in outcome.raw_only.items():
        print(f"keep raw: {scene}: {reason}")
    result = {
        "recording": str(recording),
        "width": width,
        "frames": len(frames),
        "mean": {name: round(value, 5) for name, value in mean.items()},
        "raw_only": outcome.raw_only,
        "seconds": round(outcome.elapsed_s, 1),
        "processor_seconds": {step: round(seconds, 1) for step, seconds in outcome.seconds.items()},
    }
    finish(out, result, [SceneFiles(out / scene.name).picture for scene in outcome.scenes])


_SHOWN = ("gaussians", "mesh", "lidar", "completed", "sky", "known_below_horizon", "psnr_db", "empty_below_horizon")
