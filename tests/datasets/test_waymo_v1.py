"""Waymo v1: a drive written by the test helpers comes back, a frame is computed by hand, damage is named."""

from __future__ import annotations

import shutil
import tracemalloc
import zlib
from pathlib import Path

import numpy as np
import pytest

from coin3d.datasets import file_span, waymo_v1
from coin3d.datasets.file_span import EncodedImage
from coin3d.datasets.open import open_recording
from coin3d.datasets.waymo_v1 import WaymoV1Recording
from coin3d.datasets.waymo_v1_frame import read_matrix
from coin3d.geometry import BrownConrady, Pinhole
from same_frames import assert_same
from waymo_drive import PNG, Drive, make_drive
from waymo_writer import content, frame_payload, matrix, packed, real, record, varint, whole, write_v1

MOVED = np.eye(4)
MOVED[:3, 3] = (99.0, 50.0, 7.0)


@pytest.fixture(scope="module")
def drive() -> Drive:
    return make_drive()


@pytest.fixture(scope="module")
def written(drive: Drive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_v1(tmp_path_factory.mktemp("waymo") / "segment-1.tfrecord", drive)


@pytest.fixture
def path(written: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(written, tmp_path / "segment-1.tfrecord"))


def pose(x: float, y: float, z: float) -> bytes:
    transform = np.eye(4)
    transform[:3, 3] = (x, y, z)
    return real(1, *transform.ravel())


CALIBRATION = real(2, 80, 82, 47, 33, 0, 0, 0, 0, 0) + content(3, pose(1.5, 0.1, 2))
IMAGE = content(2, PNG.encode(np.full((64, 96, 3), 9, np.uint8)))
BOX = content(1, real(1, 10) + real(2, 2) + real(3, 1) + real(4, 1.9) + real(5, 4.5) + real(6, 1.5) + real(7, 0.25))


def minimal(**changes: bytes) -> bytes:
    """One camera, one box. The image was taken when the vehicle was 1 m short of where it is at the frame's time."""
    parts = {
        "name": b"street-1",
        "calibration": content(2, whole(1, 1), CALIBRATION, whole(4, 96), whole(5, 64)),
        "time": whole(2, 5_000_001),
        "pose": content(3, pose(100, 50, 7)),
        "image": content(4, whole(1, 1), IMAGE, content(3, pose(99, 50, 7))),
        "label": content(6, BOX, content(2, real(1, 3) + real(2, -4)), whole(3, 4), content(4, b"bike"), whole(7, 11)),
        **changes,
    }
    context = content(1, content(1, parts.pop("name")), parts.pop("calibration"))
    return parts.pop("context", context) + b"".join(parts.values())


def open_minimal(folder: Path, **changes: bytes) -> WaymoV1Recording:
    (folder / "a.tfrecord").write_bytes(record(minimal(**changes)))
    return WaymoV1Recording(folder)


def test_a_drive_comes_back(written: Path, drive: Drive) -> None:
    recording = open_recording(written.parent, undistort=False)
    assert isinstance(recording, WaymoV1Recording) and len(recording) == 3
    for read, truth in zip(recording, drive.frames, strict=True):
        assert_same(read, truth)
    single = open_recording(written, undistort=False)  # the file alone
    assert_same(single[-1], drive.frames[-1])
    with pytest.raises(IndexError):
        single[3]


def test_lenses_are_taken_out_unless_asked_not_to(written: Path, drive: Drive) -> None:
    bent = open_recording(written, undistort=False)[0].rig["FRONT"].lens
    assert bent == BrownConrady(*drive.distortion)
    straight = open_recording(written)[0]
    assert all(isinstance(camera.lens, Pinhole) for camera in straight.rig.values())
    assert straight.image("FRONT").shape == drive.frames[0].image("FRONT").shape


def test_both_returns(written: Path, drive: Drive) -> None:
    for read, points in zip(WaymoV1Recording(written, second_return=True), drive.both, strict=True):
        assert read.lidar is not None
        np.testing.assert_allclose(read.lidar.load().points_ego, points, atol=1e-6)
    assert len(points) > len(drive.frames[-1].lidar.load().points_ego)


def test_a_frame_by_hand(tmp_path: Path) -> None:
    (frame,) = open_minimal(tmp_path)
    assert (frame.token, frame.scene, frame.timestamp_ns) == ("street-1-5000001", "street-1", 5_000_001_000)
    camera = frame.rig["FRONT"]
    np.testing.assert_allclose(camera.ego_from_cam.translation, (0.5, 0.1, 2))
    np.testing.assert_allclose(camera.ego_from_cam.rotation, [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], atol=1e-12)
    assert camera.K.tolist() == [[80, 0, 47], [0, 82, 33], [0, 0, 1]]  # counted from the edge already
    boxes = frame.boxes_world
    assert boxes is not None and boxes.labels.tolist() == ["CYCLIST"] and boxes.instance_ids.tolist() == ["bike"]
    np.testing.assert_allclose(boxes.centre_m, [(110, 52, 8)])
    np.testing.assert_allclose(boxes.size_m, [(4.5, 1.9, 1.5)])  # the width is the field before the length
    np.testing.assert_allclose(boxes.velocity_mps, [(3, -4)])
    assert boxes.yaw_rad.tolist() == [0.25] and boxes.num_lidar_points.tolist() == [11]
    assert frame.lidar is None and frame.image("FRONT")[0, 0].tolist() == [9, 9, 9]


def test_what_is_unknown_stays_unknown(tmp_path: Path) -> None:
    (frame,) = open_minimal(tmp_path, label=content(6, BOX))
    boxes = frame.boxes_world
    assert boxes is not None and boxes.labels.tolist() == ["UNKNOWN"] and np.isnan(boxes.velocity_mps).all()
    assert boxes.num_lidar_points.tolist() == [-1] and boxes.instance_ids.tolist() == [""]
    (bare,) = open_minimal(tmp_path, label=b"", laser=content(5) * 5)
    assert bare.boxes_world is None and bare.lidar is None


def test_nothing_is_decoded_before_it_is_asked_for(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    decoded, payloads = [], []
    decode, read = file_span.decode_image, waymo_v1.read_payload
    monkeypatch.setattr(file_span, "decode_image", lambda data, where, *how: decoded.append(where) or decode(data, where, *how))
    monkeypatch.setattr(waymo_v1, "read_payload", lambda span: payloads.append(span.start) or read(span))
    recording = WaymoV1Recording(path)
    assert payloads == []
    frame = recording[1]
    assert len(payloads) == 1 and decoded == []
    assert all(isinstance(image, EncodedImage) and image.span.length < 60_000 for image in frame.images.values())
    frame.image("SIDE_LEFT")
    assert len(decoded) == 1 and "segment-1.tfrecord: image SIDE_LEFT at byte" in decoded[0]


def test_the_index_spares_the_second_look(path: Path, drive: Drive, monkeypatch: pytest.MonkeyPatch) -> None:
    WaymoV1Recording(path)
    assert path.with_name("segment-1.tfrecord.index.json").is_file()
    spans = waymo_v1.record_spans
    monkeypatch.setattr(waymo_v1, "record_spans", lambda path: pytest.fail("looked again"))
    assert_same(WaymoV1Recording(path)[0], drive.frames[0])
    monkeypatch.setattr(waymo_v1, "record_spans", spans)
    path.write_bytes(b"".join(record(frame_payload(drive, k)) for k in (2, 0)))  # any order, one frame less
    first, second = WaymoV1Recording(path)
    assert (first.token, first.next, second.previous) == (drive.frames[0].token, second.token, first.token)


def test_segments_and_splits(tmp_path: Path) -> None:
    def put(split: str, name: str, *times: int) -> None:
        (tmp_path / split).mkdir(exist_ok=True)
        frames = b"".join(record(minimal(name=name.encode(), time=whole(2, t))) for t in times)
        (tmp_path / split / f"{name}.tfrecord").write_bytes(frames)

    put("training", "b", 20, 10)
    put("training", "a", 15)
    put("validation", "c", 5)
    recording = open_recording(tmp_path, undistort=False)
    assert [(f.token, f.previous, f.next) for f in recording] == [
        ("a-15", "", ""), ("b-10", "", "b-20"), ("b-20", "b-10", ""), ("c-5", "", ""),
    ]  # fmt: skip
    assert [f.token for f in WaymoV1Recording(tmp_path, split="validation")] == ["c-5"]
    for split in ("testing", "..", "training/.."):
        with pytest.raises(FileNotFoundError, match=r"no \.tfrecord files there"):
            WaymoV1Recording(tmp_path, split=split)
    shutil.copy(tmp_path / "training/a.tfrecord", tmp_path / "copy.tfrecord")
    with pytest.raises(ValueError, match=r"a\.tfrecord: holds the frame a-15 that is in .*copy\.tfrecord as well"):
        open_recording(tmp_path, undistort=False)
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "a.tfrecord").write_bytes(b"")
    with pytest.raises(ValueError, match="hold no frames"):
        open_recording(tmp_path / "empty")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": b"../../etc"}, r"record 0: '\.\./\.\./etc' is no name of a segment"),
        ({"name": b"a/b"}, "is no name of a segment"),
        ({"name": b""}, "is no name of a segment"),
        ({"context": b""}, "'None' is no name of a segment"),
        ({"context": content(1, content(1, b"a")) * 2}, "context occurs 2 times"),
        ({"time": b""}, "None is no time in microseconds"),
        ({"time": whole(2, 2**63)}, "is no time in microseconds"),
        ({"pose": b""}, "has no pose"),
        ({"pose": content(3, real(1, *range(15)))}, "pose: a transform has 16 numbers, got 15"),
        ({"pose": content(3, real(1, *(2 * np.eye(4)).ravel()))}, "pose: the last row"),
        ({"pose": content(3, real(1, *np.diag([2.0, 1, 1, 1]).ravel()))}, "pose: not a rotation matrix"),
        ({"image": b""}, "the frame has no images"),
        ({"image": content(4, whole(1, 9), IMAGE)}, "image 0: 9 is none of 1 FRONT, 2 FRONT_LEFT"),
        ({"image": content(4, whole(1, 1))}, "no image of FRONT"),
        ({"image": content(4, whole(1, 1), IMAGE, content(3, pose(0, 0, 0))) * 2}, "image 1: a second image of FRONT"),
        ({"image": content(4, whole(1, 2), IMAGE, content(3, pose(0, 0, 0)))}, "FRONT_LEFT has an image but no calibration"),
        ({"calibration": content(2, whole(1, 1), real(2, 80, 80))}, "the intrinsic has 9 finite numbers"),
        ({"calibration": content(2, whole(1, 1), CALIBRATION, whole(5, 64))}, "FRONT: an image of 0 x 64 pixels"),
        ({"calibration": content(2, whole(1, 1), CALIBRATION, whole(5, 64)) * 2}, "a second calibration of FRONT"),
        ({"label": content(6, whole(3, 1))}, "label 0: has no box"),
        ({"label": content(6, BOX, whole(3, 5))}, "label 0: 5 is none of 0 UNKNOWN"),
        ({"label": content(6, content(1, real(1, 3)))}, "label 0: a box of .*sizes are positive metres"),
        ({"label": content(6, BOX, whole(7, 2**40))}, "label 0: a box of .* with 1099511627776 LiDAR points"),
        ({"laser": content(5, content(2, content(2, b"x")))}, "laser 0: None is none of 1 TOP"),
        ({"laser": varint(5 << 3) + b"\x07"}, r"laser \(field 5\) is a whole number where a string or message"),
    ],
)
def test_frames_that_make_no_sense(tmp_path: Path, changes: dict[str, bytes], message: str) -> None:
    with pytest.raises(ValueError, match=rf"a\.tfrecord: .*{message}"):
        open_minimal(tmp_path, **changes)[0]


def test_a_laser_without_calibration_and_a_range_image_that_is_none(tmp_path: Path) -> None:
    whole_image = matrix(np.ones((1, 4, 4)))
    for image, message in (
        (whole_image, "TOP has range images but no calib"),
        (b"no zlib", "TOP: return 1: cannot be unpacked"),
    ):
        (frame,) = open_minimal(tmp_path, laser=content(5, whole(1, 1), content(2, content(2, image))))
        assert frame.lidar is not None
        with pytest.raises(ValueError, match=rf"a\.tfrecord: frame 5000001 .*: laser {message}"):
            frame.lidar.load()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (zlib.compress(packed(1, [1, 2, 3]) + content(2, whole(1, 1), whole(1, 3))), r"3 numbers for the shape \[1, 3\]"),
        (zlib.compress(packed(1, [1, 2, 3]) + content(2, *(whole(1, n) for n in (1, 3, 2)))), "3 numbers for the shape"),
        (zlib.compress(content(2, *(whole(1, 2**40) for _ in range(3)))), "0 numbers for the shape"),
        (zlib.compress(packed(1, [1, 2, 3])), r"3 numbers for the shape \[\]"),
        (matrix(np.ones((2, 2, 4)))[:-5], "is cut short"),
        (b"", "is cut short"),
        (b"\x78\x9cnot zlib", "cannot be unpacked"),
    ],
)
def test_matrices_that_are_none(data: bytes, message: str) -> None:
    with pytest.raises(ValueError, match=f"^x: {message}"):
        read_matrix(data, "x")


def test_a_matrix_that_unpacks_to_more_than_any_range_image() -> None:
    packer = zlib.compressobj(1)
    bomb = b"".join(packer.compress(bytes(1 << 20)) for _ in range(64)) + packer.flush()
    tracemalloc.start()
    with pytest.raises(ValueError, match="has more than"):
        read_matrix(bomb, "x")
    assert tracemalloc.get_traced_memory()[1] < 90_000_000
    tracemalloc.stop()


def test_a_file_that_was_exchanged(path: Path, drive: Drive) -> None:
    recording = WaymoV1Recording(path)
    frame = recording[0]
    path.write_bytes(path.read_bytes() + record(minimal()))
    for use in (lambda: recording[1], lambda: frame.image("FRONT"), lambda: frame.lidar.load()):
        with pytest.raises(ValueError, match="changed while it was in use; open the recording again"):
            use()
