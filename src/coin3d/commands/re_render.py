"""``coin3d re-render``: a recording as another rig would have seen it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg


def re_render(
    recording: Annotated[Positional[Path], arg(metavar="RECORDING")],
    gaussians: Annotated[Positional[Path], arg(metavar="GAUSSIANS")],
    out: Path,
    rig: Annotated[str, arg(metavar="RIG")],
    split: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="(default: all scenes)")] = None,
    width: int = 704,
    threads: int = 2,
) -> None:
    """Write a recording anew, seen through another rig, from its frames as Gaussians. Boxes and LiDAR stay.

    A detector trained on one copy and scored on another meets a new rig and nothing else that is new: this is how the paper
    compares nuScenes seen by nuScenes' rig with nuScenes seen by Waymo's.

    Try:
      coin3d build-scenes data/nuscenes --out data/gaussians
      coin3d re-render data/nuscenes data/gaussians --rig waymo --split val --out data/as-waymo
      coin3d evaluate runs/mine/model.safetensors data/as-waymo --out out/score --protocol nuscenes-to-nuscenes-as-waymo

    Args:
        recording: folder of the recording.
        gaussians: folder that build-scenes wrote for it; frames that are not in it are left out.
        out: folder to write the copy into, with rig.yaml and frames.jsonl; it must be empty.
        rig: a preset (nuscenes, lyft1, lyft2, waymo) or a rig.yaml.
        split: only these scenes: a split of nuScenes, Lyft or DDAD (val), or a text file with scene names.
        width: images are rendered at this width, as high as the rig's images are in proportion.
        threads: of the renderer.
    """
    from coin3d.commands.outcome import finish
    from coin3d.datasets.folder_writer import write_folder_recording
    from coin3d.datasets.open import open_recording
    from coin3d.geometry import fit_width
    from coin3d.rendering.gaussian_folder import GaussianFolder
    from coin3d.rendering.rendered_frames import rendered_frames
    from coin3d.rig_report import find_rig

    source, built, seen_by = open_recording(recording, split), GaussianFolder.open(gaussians), find_rig(rig)
    cameras = {}
    for name, camera in seen_by.items():
        cameras[name] = fit_width(camera, width, round(camera.height_px * width / camera.width_px)).camera(camera)
    count = write_folder_recording(rendered_frames(source, built, seen_by.with_cameras(cameras), threads), out)
    print(f"{count} of {len(source)} frames rendered through rig '{seen_by.name}' into {out}")
    finish(out, {"recording": str(recording), "rig": seen_by.name, "frames": len(source), "rendered": count})
