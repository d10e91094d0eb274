"""Open a recording without saying what format it is in."""

from __future__ import annotations

from pathlib import Path

from coin3d.datasets.dgp import DgpRecording, is_dgp
from coin3d.datasets.folder import RIG_FILE, FolderRecording
from coin3d.datasets.frame import Recording
from coin3d.datasets.frames_file import FRAMES_FILE
from coin3d.datasets.nuscenes_format import NuScenesRecording
from coin3d.datasets.own_recording import OwnRecording
from coin3d.datasets.splits import SplitChoice, no_split


def open_recording(path: Path | str, split: SplitChoice | None = None) -> Recording:
    """The recording in a folder: a user's images with ``rig.yaml``, nuScenes-format tables, or DGP (DDAD) scenes.

    Args:
        path: the folder.
        split: which scenes: the name of a split (``train``, ``val``, ...) where the data set has them, a text file with one
            scene name per line (its name ends in .txt), or the scene names; by default all.

    Raises:
        FileNotFoundError: nothing there, or nothing that looks like a recording.
        ValueError: the recording is damaged, or has no such split; the message says where.
    """
    path = Path(path)
    if not path.is_dir():
        raise FileNotFoundError(f"{path}: no such folder; give the folder of a recording")
    if (path / FRAMES_FILE).is_file():
        return OwnRecording(path, split)
    if (path / RIG_FILE).is_file():
        no_split(split, str(path), f"name scenes in {FRAMES_FILE} first (docs/your_rig.md)")
        return FolderRecording(path)
    if any(next(path.glob(pattern), None) for pattern in ("sample.json", "*/sample.json", "*/*/sample.json")):
        return NuScenesRecording(path, split=split)
    if is_dgp(path):
        return DgpRecording(path, split)
    raise FileNotFoundError(
        f"{path}: not a recording: looked for {RIG_FILE} (own images, see docs/your_rig.md) and for */sample.json "
        "(nuScenes-format tables) and for a JSON file with scene_splits (DDAD); see docs/datasets.md"
    )
