"""Open a recording without saying what format it is in."""

from __future__ import annotations

from pathlib import Path

from coin3d.datasets.dgp import DgpRecording, is_dgp
from coin3d.datasets.folder import RIG_FILE, FolderRecording
from coin3d.datasets.frame import Recording
from coin3d.datasets.nuscenes_format import NuScenesRecording
from coin3d.datasets.undistorted import UndistortedRecording
from coin3d.datasets.waymo_v1 import WaymoV1Recording, is_waymo_v1
from coin3d.datasets.waymo_v2 import WaymoV2Recording, is_waymo_v2
from coin3d.geometry.undistort import has_lens


def open_recording(path: Path | str, undistort: bool = True) -> Recording:
    """The recording in a folder: a user's images with ``rig.yaml``, nuScenes-format tables, DGP (DDAD) scenes, or Waymo.

    Args:
        path: the folder; of Waymo also a single TFRecord file.
        undistort: give frames of pinhole cameras, images resampled when they are loaded, where the calibration has lenses;
            otherwise frames come as they were recorded.

    Raises:
        FileNotFoundError: nothing there, or nothing that looks like a recording.
        ValueError: the recording is damaged; the message says where.
    """
    path = Path(path)
    if path.is_file() and is_waymo_v1(path):
        return _with_lenses(WaymoV1Recording(path), undistort)
    if not path.is_dir():
        raise FileNotFoundError(f"{path}: no such folder; give the folder of a recording")
    if (path / RIG_FILE).is_file():
        folder = FolderRecording(path)
        return UndistortedRecording(folder) if undistort and has_lens(folder.rig) else folder
    if any(
        next(path.glob(pattern), None) for pattern in ("sample.json", "*/sample.json", "*/*/sample.json")
    ):  # tables that have no place for a lens
        return NuScenesRecording(path)
    if is_waymo_v2(path):
        return _with_lenses(WaymoV2Recording(path), undistort)
    if is_waymo_v1(path):
        return _with_lenses(WaymoV1Recording(path), undistort)
    if is_dgp(path):
        return DgpRecording(path)
    raise FileNotFoundError(
        f"{path}: not a recording: looked for {RIG_FILE} (own images, see docs/your_rig.md) and for */sample.json "
        "(nuScenes-format tables), for a JSON file with scene_splits (DDAD), for *.tfrecord or camera_image/*.parquet (Waymo); "
        "see docs/datasets.md"
    )


def _with_lenses(recording: Recording, undistort: bool) -> Recording:
    """A recording of a format that always has lenses."""
    return UndistortedRecording(recording) if undistort else recording
