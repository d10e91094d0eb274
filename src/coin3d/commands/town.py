"""``coin3d town``: record the embedded data set through any rig."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from coin3d.commands.outcome import finish


def town(
    out: Path,
    rig: str = "nuscenes",
    width: Annotated[int, arg(metavar="PX")] = 400,
    scenes: int = 4,
    first_seed: int = 0,
    key_frames: int = 20,
    sweeps: bool = False,
    slope: bool = False,
    true_depth: bool = False,
    workers: int = 2,
) -> None:
    """Record a synthetic street world through a rig, in nuScenes format, with exact boxes and LiDAR.

    A seed is a world: two rigs with the same seeds record the same streets and the same traffic, so whatever changes is
    the rig's doing. Called again, also with more scenes, it continues where it stopped.

    Try:
      coin3d town --out data/train --rig nuscenes --scenes 60
      coin3d town --out data/train_waymo --rig waymo --scenes 60
      coin3d town --out data/van --rig recordings/van/rig.yaml --scenes 10

    Args:
        out: folder of the recording.
        rig: a preset (nuscenes, lyft1, lyft2, waymo) or a rig.yaml.
        width: image width for presets; a rig.yaml says its own.
        scenes: number of worlds, one scene each.
        first_seed: seed of the first world; the others follow.
        key_frames: annotated frames per scene, 0.5 s apart.
        sweeps: also LiDAR sweeps between key frames, at 10 Hz.
        slope: hilly ground.
        true_depth: also depth images.
        workers: processes.
    """
    need_ray_casting()
    from coin3d.datasets.open import open_recording
    from coin3d.town.command import town_command

    picture = town_command(
        out,
        rig=rig,
        width=width,
        scenes=scenes,
        first_seed=first_seed,
        key_frames=key_frames,
        sweeps=sweeps,
        slope=slope,
        true_depth=true_depth,
        workers=workers,
    )
    recorded = open_recording(out)
    result = {
        "recording": str(out),
        "rig": rig,
        "scenes": scenes,
        "first_seed": first_seed,
        "frames": len(recorded),
        "boxes": sum(len(frame.boxes_world) for frame in recorded if frame.boxes_world is not None),
    }
    print(f"{result['frames']} frames with {result['boxes']} boxes in {out}")
    finish(out, result, [picture])


def need_ray_casting() -> None:
    """Raises ImportError with the remedy where the town cannot be rendered."""
    try:
        import embreex  # noqa: F401
    except ImportError as error:
        raise ImportError(
            "the town is ray-cast with embreex, which is not installed: pip install 'coin3d[town]' (x86-64 only)"
        ) from error
