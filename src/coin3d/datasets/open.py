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
from coin3d.datasets.undistorted import UndistortedRecording
from coin3d.datasets.waymo_v1 import WaymoV1Recording, is_waymo_v1
from coin3d.datasets.waymo_v2 import WaymoV2Recording, is_waymo_v2
from coin3d.geometry.undistort import has_lens


def open_recording(path: Path | str, split: SplitChoice | None = None, *, undistort: bool = True) -> Recording:
    """The recording in a folder: a user's own, nuScenes-format tables, DGP (DDAD) scenes, or Waymo.

    Args:
        path: the folder; of Waymo also a single TFRecord file.
        split: which scenes: the name of a split (``train``, ``val``, ...) where the data set has them, a text file with one
            scene name per line (its name ends in .txt), or the scene names; by default all. Of Waymo the name of its folder.
        undistort: give frames of pinhole cameras, images resampled when they are loaded, where the calibration has lenses;
            otherwise frames come as they were recorded.

    Raises:
        FileNotFoundError: nothing there, or nothing that looks like a recording.
        ValueError: the recording is damaged, or has no such split; the message says where.
    """
    path = Path(path)
    if path.is_file() and is_waymo_v1(path):
        no_split(split, str(path), "a single file is a part of one")
        return _with_lenses(WaymoV1Recording(path), undistort)
    if not path.is_dir():
        raise FileNotFoundError(f"{path}: no such folder; give the folder of a recording")
    if (path / FRAMES_FILE).is_file():
        return _with_lenses(OwnRecording(path, split), undistort)
    if (path / RIG_FILE).is_file():
        no_split(split, str(path), f"name scenes in {FRAMES_FILE} first (docs/your_rig.md)")
        folder = FolderRecording(path)
        return _with_lenses(folder, undistort) if has_lens(folder.rig) else folder
    if any(next(path.glob(pattern), None) for pattern in ("sample.json", "*/sample.json", "*/*/sample.json")):
        return NuScenesRecording(path, split=split)  # these tables have no place for a lens
    if is_waymo_v2(path):
        return _with_lenses(WaymoV2Recording(path, _folder_name(split, path)), undistort)
    if is_waymo_v1(path):
        return _with_lenses(WaymoV1Recording(path, _folder_name(split, path)), undistort)
    if is_dgp(path):
        return DgpRecording(path, split)
    raise FileNotFoundError(
        f"{path}: not a recording: looked for {RIG_FILE} (own images, see docs/your_rig.md) and for */sample.json "
        "(nuScenes-format tables), for a JSON file with scene_splits (DDAD), for *.tfrecord and camera_image/*.parquet "
        "(Waymo); see docs/datasets.md"
    )


def _with_lenses(recording: Recording, undistort: bool) -> Recording:
    """A recording of a format that knows lenses."""
    return UndistortedRecording(recording) if undistort else recording


def _folder_name(split: SplitChoice | None, path: Path) -> str | None:
    """Waymo's splits are folders."""
    if split is None or (isinstance(split, str) and not split.endswith(".txt")):
        return split
    raise ValueError(f"{path}: a split of Waymo is the name of one of its folders (training, validation), got {split}")
