"""Two drives through the town, written in every format by test helpers, read back to the frames they were written from.

How exactly follows from the numbers a format stores:

* poses, boxes, calibrations: double precision, as text or bytes, everywhere. 1 nm covers the products of a few poses.
* headings: exact where boxes stand in the world's frame. DGP, Waymo and ``boxes_ego`` store them in a frame that leans with the
  vehicle; an upright box then keeps its heading up to the square of the lean.
* LiDAR: float32 in the frame of the sensor (nuScenes, Lyft, .bin, binary .pcd): half a unit in the last place below 128 m is
  4 micrometres per axis. Double precision in DGP, .npy and ascii .pcd. Waymo's ranges and pixel poses are float32, and the
  drives' points are computed from these very numbers.
* times: nuScenes, DGP and Waymo count whole microseconds; Lyft's have decimals, which are rounded away.
* pictures: PNG in DGP and own recordings (and here in Waymo, whose readers take what the bytes are), exact. nuScenes and Lyft
  have JPEG: quality 95 moves pixels of these pictures by less than 4 levels of 255 on average.
* velocities: stored by Waymo and own recordings, differences between annotations otherwise; all double precision. Those of
  ``boxes_ego`` are two numbers in a frame that leans, which is exact up to the square of the lean as well.
* LiDAR counts: Lyft has none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from coin3d.datasets.classes import THREE_CLASS
from coin3d.datasets.dgp import DgpRecording
from coin3d.datasets.folder import FolderRecording
from coin3d.datasets.frame import Frame
from coin3d.datasets.nuscenes_format import NuScenesRecording
from coin3d.datasets.open import open_recording
from coin3d.datasets.own_recording import OwnRecording
from coin3d.datasets.waymo_v1 import WaymoV1Recording
from coin3d.datasets.waymo_v2 import WaymoV2Recording
from coin3d.geometry import Pose, Rig
from dgp_writer import write_dgp
from own_writer import write_images, write_own
from same_frames import assert_same
from table_writer import BROKEN_LIDAR, JPEG_LEVELS, write_lyft, write_nuscenes
from town_drives import make_town_drives, relabelled
from waymo_drive import Drive
from waymo_writer import write_v1, write_v2

EXACT_M = 1e-9
FLOAT32_M = 1.5e-5
FASTEST_MPS = 15.0

TOWN = ("vehicle.car", "vehicle.truck", "vehicle.bus.rigid", "vehicle.bicycle", "vehicle.motorcycle", "human.pedestrian.adult")
LYFT_NAMES = ("car", "truck", "bus", "bicycle", "motorcycle", "pedestrian")
DGP_NAMES = ("Car", "Truck", "Bus/RV/Caravan", "Bicycle", "Motorcycle", "Person")
WAYMO_NAMES = ("VEHICLE", "VEHICLE", "VEHICLE", "CYCLIST", "CYCLIST", "PEDESTRIAN")


def write_waymo_v1(root: Path, drives: list[Drive]) -> Path:
    for drive in drives:
        write_v1(root / f"{drive.segment}.tfrecord", drive)
    return root


def write_waymo_v2(root: Path, drives: list[Drive]) -> Path:
    for drive in drives:
        write_v2(root, drive)
    return root


@dataclass(frozen=True)
class Format:
    """A format: who writes it, who should read it, and what it stores how exactly."""

    write: Callable[[Path, list[Drive]], Path]
    reader: type
    names: tuple[str, ...]
    lidar_metres: float = EXACT_M
    boxes_lean: bool = False
    velocities_lean: bool = False
    colour_levels: float = 0.0
    counts_points: bool = True
    knows_visibility: bool = False
    fits_ground: bool = False


FORMATS = {
    "nuscenes": Format(
        write_nuscenes, NuScenesRecording, TOWN, FLOAT32_M, colour_levels=JPEG_LEVELS, knows_visibility=True
    ),
    "lyft": Format(
        write_lyft, NuScenesRecording, LYFT_NAMES, FLOAT32_M, colour_levels=JPEG_LEVELS, counts_points=False
    ),
    "dgp": Format(write_dgp, DgpRecording, DGP_NAMES, boxes_lean=True, fits_ground=True),
    "own": Format(
        write_own, OwnRecording, TOWN, FLOAT32_M, boxes_lean=True, velocities_lean=True, knows_visibility=True
    ),
    "waymo v1": Format(write_waymo_v1, WaymoV1Recording, WAYMO_NAMES, boxes_lean=True),
    "waymo v2": Format(write_waymo_v2, WaymoV2Recording, WAYMO_NAMES, boxes_lean=True),
}  # fmt: skip


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> list[Drive]:
    return make_town_drives(tmp_path_factory.mktemp("town"))


@pytest.fixture(scope="module", params=FORMATS)
def written(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, drives: list[Drive]):
    """The format, the folder, and the frames that should come out of it."""
    form = FORMATS[request.param]
    named = [relabelled(drive, dict(zip(TOWN, form.names, strict=True))) for drive in drives]
    root = form.write(tmp_path_factory.mktemp("recording"), named)
    truth = [as_stored(frame, form) for drive in named for frame in drive.frames]
    return form, root, truth


def as_stored(frame: Frame, form: Format) -> Frame:
    """The frame without what the format has no place for."""
    boxes = frame.boxes_world
    assert boxes is not None
    if not form.counts_points:
        boxes = replace(boxes, num_lidar_points=np.full(len(boxes), -1))
    if not form.knows_visibility:
        boxes = replace(boxes, visibility=np.zeros(len(boxes), dtype=np.int64))
    return frame.with_boxes_world(boxes)


def lean_rad(pose: Pose) -> float:
    return float(np.arccos(np.clip(pose.rotation[2, 2], -1, 1)))


def test_the_drives_are_worth_writing(drives: list[Drive]) -> None:
    """What is compared below is there: motion, unknown speeds, leaning, cameras that fire elsewhere, images of four sizes."""
    frames = [frame for drive in drives for frame in drive.frames]
    boxes = [frame.boxes_world for frame in frames]
    assert [len(drive.frames) for drive in drives] == [3, 2] and min(map(len, boxes)) > 10
    assert {str(label) for table in boxes for label in table.labels} >= {"vehicle.car", "human.pedestrian.adult"}
    speed = np.concatenate([np.linalg.norm(table.velocity_mps, axis=1) for table in boxes])
    assert np.isnan(speed).any() and np.nanmax(speed) > 1
    assert len({level for table in boxes for level in table.visibility.tolist()}) > 1
    assert max(lean_rad(frame.world_from_ego) for frame in frames) > 0.005
    assert min(len(frame.lidar.load().points_ego) for frame in frames) > 500
    moved = [c.ego_from_cam.translation - drives[0].mounts[n].ego_from_cam.translation for n, c in frames[0].rig.items()]
    assert np.abs(moved).max() > 0.01
    assert len({(c.width_px, c.height_px) for frame in frames for c in frame.rig.values()}) == 4


def test_frames_come_back(written: tuple[Format, Path, list[Frame]]) -> None:
    form, root, truth = written
    recording = open_recording(root)
    assert isinstance(getattr(recording, "recorded", recording), form.reader)
    assert len(recording) == len(truth)
    for read, frame in zip(recording, truth, strict=True):
        lean = lean_rad(frame.world_from_ego) ** 2
        assert_same(
            read,
            frame,
            metres=EXACT_M,
            mps=EXACT_M + (lean * FASTEST_MPS if form.velocities_lean else 0),
            lidar_metres=form.lidar_metres,
            yaw_rad=EXACT_M + (lean if form.boxes_lean else 0),
            colour_levels=form.colour_levels,
        )
        if form.fits_ground:  # to a cloud of few points on a hill
            under = frame.rig.ground.height_m(np.array([0.0, 0, 0])) - read.rig.ground.height_m(np.array([0.0, 0, 0]))
            assert abs(under) < 0.3
        else:
            assert read.rig.ground.is_default


def test_classes_are_the_same_in_every_format(written: tuple[Format, Path, list[Frame]], drives: list[Drive]) -> None:
    _, root, _ = written
    source = [frame.boxes_world for drive in drives for frame in drive.frames]
    for read, boxes in zip(open_recording(root), source, strict=True):
        assert THREE_CLASS.apply(read.boxes_world).labels.tolist() == THREE_CLASS.apply(boxes).labels.tolist()


def test_any_order_gives_what_iteration_gives(written: tuple[Format, Path, list[Frame]]) -> None:
    _, root, _ = written
    in_order = list(open_recording(root))
    recording = open_recording(root)
    for index in (3, 0, 4, 4, 1, -1, 2, -5):
        assert_same(recording[index], in_order[index], metres=0.0, yaw_rad=1e-15)
    with pytest.raises(IndexError):
        recording[5]


def test_the_broken_sweep_of_lyft_was_among_them(tmp_path: Path, drives: list[Drive]) -> None:
    names = dict(zip(TOWN, LYFT_NAMES, strict=True))
    root = write_lyft(tmp_path, [relabelled(drive, names) for drive in drives])
    broken = root / "lidar" / BROKEN_LIDAR
    assert broken.stat().st_size // 4 % 5 == 3
    (root / "train_lidar").mkdir()  # an empty folder as downloaded must not win over the one in use
    assert open_recording(root)[0].lidar.path == broken


def test_a_folder_of_images(tmp_path: Path, drives: list[Drive]) -> None:
    drive = drives[0]
    recording = open_recording(write_images(tmp_path / "van", drive))
    assert isinstance(recording, FolderRecording)
    for read, frame in zip(recording, drive.frames, strict=True):
        plain = replace(
            frame,
            timestamp_ns=0,
            rig=Rig(drive.mounts),
            world_from_ego=Pose.identity(),
            boxes_world=None,
            lidar=None,
            scene="van",
        )
        assert_same(read, plain, metres=EXACT_M)
