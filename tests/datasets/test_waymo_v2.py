"""Waymo v2: a drive written by the test helpers comes back, only what is needed is read, damage is named."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from coin3d.datasets.open import open_recording
from coin3d.datasets.waymo_v2 import WaymoV2Recording
from same_frames import assert_same
from waymo_drive import Drive, make_drive
from waymo_writer import COMPONENTS, write_v2


@pytest.fixture(scope="module")
def drive() -> Drive:
    return make_drive()


@pytest.fixture(scope="module")
def written(drive: Drive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_v2(tmp_path_factory.mktemp("waymo"), drive)


@pytest.fixture
def root(written: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(written, tmp_path / "waymo"))


def file_of(root: Path, tag: str) -> Path:
    return next((root / tag).glob("*.parquet"))


def rewrite(root: Path, tag: str, change: Callable[[pa.Table], pa.Table]) -> None:
    path = file_of(root, tag)
    pq.write_table(change(pq.read_table(path)), path)


def with_column(table: pa.Table, name: str, values: list[Any]) -> pa.Table:
    return table.set_column(table.schema.get_field_index(name), name, pa.array(values))


def test_a_drive_comes_back(written: Path, drive: Drive) -> None:
    recording = open_recording(written, undistort=False)
    assert isinstance(recording, WaymoV2Recording) and len(recording) == 3
    for read, truth in zip(recording, drive.frames, strict=True):
        assert_same(read, truth)
    for read, points in zip(WaymoV2Recording(written, second_return=True), drive.both, strict=True):
        assert read.lidar is not None
        np.testing.assert_allclose(read.lidar.load().points_ego, points, atol=1e-6)


def test_any_order_from_one_large_row_group(tmp_path: Path, drive: Drive) -> None:
    recording = WaymoV2Recording(write_v2(tmp_path, drive, row_group_size=1000))
    for index in (2, 0, 1, -1):
        assert_same(recording[index], drive.frames[index])
    with pytest.raises(IndexError):
        recording[3]


def test_splits_and_segments(tmp_path: Path, drive: Drive) -> None:
    write_v2(tmp_path / "training", drive)
    other = make_drive("0_other", frames=1, lidar=False)
    write_v2(tmp_path / "validation", other)
    recording = open_recording(tmp_path, undistort=False)
    assert [f.token for f in recording] == [f.token for f in (*other.frames, *drive.frames)]
    assert (recording[0].next, recording[1].previous) == ("", "")
    assert_same(WaymoV2Recording(tmp_path, split="validation")[0], other.frames[0])
    for split in ("testing", "..", "training/.."):
        with pytest.raises(FileNotFoundError, match=r"no camera_image/\*\.parquet there"):
            WaymoV2Recording(tmp_path, split=split)
    shutil.copytree(tmp_path / "training", tmp_path / "again")
    with pytest.raises(ValueError, match=r"training.*holds the frame .* that is in .*again.* as well; remove one"):
        open_recording(tmp_path, undistort=False)


@pytest.mark.parametrize(("missing", "has_boxes", "has_lidar"), [
    (("lidar_box",), False, True),
    (("lidar", "lidar_pose"), True, False),
    (("lidar_calibration",), True, False),
])  # fmt: skip
def test_optional_components(tmp_path: Path, drive: Drive, missing: tuple[str, ...], has_boxes: bool, has_lidar: bool) -> None:
    frame = WaymoV2Recording(write_v2(tmp_path, drive, leave_out=missing))[0]
    assert (frame.boxes_world is not None, frame.lidar is not None) == (has_boxes, has_lidar)


def test_without_pixel_poses_points_stay_where_the_laser_saw_them(tmp_path: Path, drive: Drive) -> None:
    frame = WaymoV2Recording(write_v2(tmp_path, drive, leave_out=("lidar_pose",)))[0]
    assert frame.lidar is not None and drive.frames[0].lidar is not None
    moved = np.linalg.norm(frame.lidar.load().points_ego - drive.frames[0].lidar.load().points_ego, axis=1)
    assert 0.01 < moved.max() < 0.3  # up to half of the 0.1 m that the vehicle drives in a turn, and its turning


@pytest.mark.parametrize("tag", ["camera_calibration", "vehicle_pose"])
def test_needed_components(root: Path, tag: str) -> None:
    file_of(root, tag).unlink()
    with pytest.raises(FileNotFoundError, match=rf"{tag}.*this file of the recording is missing"):
        WaymoV2Recording(root)


def test_only_the_columns_and_row_groups_that_are_needed(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, tuple[int, ...], tuple[str, ...]]] = []
    batches, group = pq.ParquetFile.iter_batches, pq.ParquetFile.read_row_group

    def note(row_groups: Any, columns: Any) -> None:
        for column in columns:
            asked.append((column.split("]")[0].strip("["), tuple(row_groups), column.split("]")[-1]))

    def iter_batches(self: Any, *args: Any, row_groups: Any = None, columns: Any = None, **rest: Any) -> Any:
        note(row_groups, columns)
        return batches(self, *args, row_groups=row_groups, columns=columns, **rest)

    def read_row_group(self: Any, i: int, columns: Any = None, **rest: Any) -> Any:
        note([i], columns)
        return group(self, i, columns=columns, **rest)

    monkeypatch.setattr(pq.ParquetFile, "iter_batches", iter_batches)
    monkeypatch.setattr(pq.ParquetFile, "read_row_group", read_row_group)
    frame = WaymoV2Recording(root)[2]
    assert not [a for a in asked if ".image" in a[2] or "range_image" in a[2]]
    assert {a[1] for a in asked if a[0] == "CameraImageComponent"} == {(2,), (3,)}  # rows 10 to 14, four to a group
    asked.clear()
    frame.image("FRONT")
    assert asked == [("CameraImageComponent", (2,), ".image")]
    asked.clear()
    assert frame.lidar is not None
    frame.lidar.load()  # rows 4 and 5 of 6; of the poses row 2 of 3
    assert {(a[0], a[1]) for a in asked} == {("LiDARComponent", (1,)), ("LiDARPoseComponent", (0,))}
    assert {a[2] for a in asked} == {".range_image_return1.values", ".range_image_return1.shape"}


def test_the_index_spares_the_second_look(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = WaymoV2Recording(root)
    monkeypatch.setattr(pq, "ParquetFile", lambda *args, **rest: pytest.fail("looked again"))
    assert len(WaymoV2Recording(root)) == len(first)


def test_without_pyarrow_it_says_what_to_install(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(ImportError, match=r"pip install 'coin3d\[waymo\]'"):
        open_recording(root, undistort=False)


CHANGES: list[tuple[str, Callable[[pa.Table], pa.Table], str]] = [
    ("vehicle_pose", lambda t: t.drop_columns(["key.segment_context_name"]), "has no column key.segment_context_name"),
    ("vehicle_pose", lambda t: with_column(t, "key.segment_context_name", ["../x"] * 3), "is no name of a segment"),
    ("vehicle_pose", lambda t: with_column(t, "key.segment_context_name", [7] * 3), "is 7 where a string is expected"),
    ("vehicle_pose", lambda t: with_column(t, "key.frame_timestamp_micros", [-1, 2, 3]), "-1 is no time"),
    ("vehicle_pose", lambda t: with_column(t, "key.frame_timestamp_micros", ["1", "2", "3"]), "are no whole numbers"),
    ("vehicle_pose", lambda t: with_column(t, "key.frame_timestamp_micros", [1, None, 3]), "are no whole numbers"),
    ("vehicle_pose", lambda t: with_column(t, t.column_names[-1], [[1.0] * 15] * 3), "a transform has 16 numbers, got 15"),
    ("vehicle_pose", lambda t: with_column(t, t.column_names[-1], [["x"]] * 3), "is no list of numbers"),
    ("vehicle_pose", lambda t: with_column(t, t.column_names[-1], [1.0] * 3), "where a list of numbers is expected"),
    ("camera_image", lambda t: with_column(t, "key.camera_name", [9] * 15), "9 is none of 1 FRONT"),
    ("camera_image", lambda t: with_column(t, "key.camera_name", [1] * 15), "two rows of FRONT"),
    ("camera_image", lambda t: t.slice(5), "the frame has no images"),
    ("camera_image", lambda t: with_column(t, "[CameraImageComponent].image", ["x"] * 15), "where bytes are expected"),
    ("camera_image", lambda t: with_column(t, "[CameraImageComponent].image", [b"x"] * 15), "cannot be decoded as an image"),
    ("camera_calibration", lambda t: t.slice(1), "camera FRONT has an image but no calibration"),
    ("camera_calibration", lambda t: pa.concat_tables([t, t]), "a second calibration of FRONT"),
    ("camera_calibration", lambda t: with_column(t, "[CameraCalibrationComponent].width", [0.5] * 5), "0.5 where a whole"),
    ("lidar_calibration", lambda t: t.slice(1), "laser TOP has range images but no calibration"),
    ("lidar", lambda t: with_column(t, t.column_names[-3], [[2, 2, 4]] * 6), "for the shape .2.0, 2.0, 4.0."),
    ("lidar", lambda t: with_column(t, t.column_names[-3], [[-1, -1, 4]] * 6), "for the shape"),
    ("lidar", lambda t: with_column(t, "key.laser_name", [6] * 6), "6 is none of 1 TOP"),
    ("lidar_box", lambda t: with_column(t, "[LiDARBoxComponent].type", [5] * 14), "5 is none of 0 UNKNOWN"),
    ("lidar_box", lambda t: with_column(t, "[LiDARBoxComponent].box.size.x", [0.0] * 14), "length, width, height are positive"),
    ("lidar_box", lambda t: with_column(t, "[LiDARBoxComponent].box.heading", [None] * 14), "None where a number"),
]  # fmt: skip


@pytest.mark.parametrize(("tag", "change", "message"), CHANGES, ids=[f"{c[0]}-{i}" for i, c in enumerate(CHANGES)])
def test_tables_that_make_no_sense(root: Path, tag: str, change: Callable[[pa.Table], pa.Table], message: str) -> None:
    rewrite(root, tag, change)
    with pytest.raises(ValueError, match=rf"\.parquet: .*{message}"):
        use_all(root)


def use_all(root: Path) -> None:
    for frame in WaymoV2Recording(root):
        assert frame.lidar is not None
        frame.lidar.load()
        frame.image("FRONT")


@pytest.mark.parametrize("tag", COMPONENTS)
def test_files_cut_short(root: Path, tag: str) -> None:
    path = file_of(root, tag)
    whole = path.read_bytes()
    for keep in (0, 3, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:keep])
        with pytest.raises(ValueError, match=rf"{tag}.*not a whole Parquet file .*copy it again"):
            use_all(root)


def test_a_file_that_was_exchanged(root: Path) -> None:
    recording = WaymoV2Recording(root)
    frame = recording[0]
    rewrite(root, "lidar_box", lambda t: t.slice(3))
    with pytest.raises(ValueError, match="changed while it was in use; open the recording again"):
        for _ in recording:
            pass
    file_of(root, "camera_image").unlink()
    with pytest.raises(FileNotFoundError, match="camera_image"):
        frame.image("SIDE_RIGHT")
