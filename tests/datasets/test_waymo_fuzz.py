"""Damaged Waymo files of both versions: a clear error or the true frame, whatever was cut off, flipped or put in."""

from __future__ import annotations

import shutil
import tracemalloc
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from coin3d.datasets.waymo_v1 import WaymoV1Recording
from coin3d.datasets.waymo_v2 import WaymoV2Recording
from same_frames import assert_same
from waymo_drive import Drive, make_drive
from waymo_writer import COMPONENTS, frame_payload, record, varint, write_v2

FEW = settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
MAX_BYTES = 60_000_000

Flips = st.lists(st.tuples(st.integers(0, 2**31), st.integers(0, 7)), min_size=1, max_size=4)


@pytest.fixture(scope="module")
def drive() -> Drive:
    return make_drive(frames=2, blank=True)


@pytest.fixture(scope="module")
def payloads(drive: Drive) -> list[bytes]:
    return [frame_payload(drive, k) for k in range(2)]


@pytest.fixture(scope="module")
def tables(drive: Drive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_v2(tmp_path_factory.mktemp("v2"), drive)


def flipped(data: bytes, flips: list[tuple[int, int]]) -> bytes:
    found = bytearray(data)
    for place, bit in flips:
        found[place % len(found)] ^= 1 << bit
    return bytes(found)


def v1_frames(path: Path) -> int:
    """Everything of all frames; how many there are."""
    path.with_name(f"{path.name}.index.json").unlink(missing_ok=True)
    count = 0
    for frame in WaymoV1Recording(path):
        for name in frame.rig:
            frame.image(name)
        if frame.lidar is not None:
            frame.lidar.load()
        count += 1
    return count


@FEW
@given(cut=st.floats(0, 1, exclude_max=True))
def test_v1_cut_anywhere(tmp_path: Path, payloads: list[bytes], cut: float) -> None:
    records = [record(payload) for payload in payloads]
    whole = b"".join(records)
    keep = int(cut * len(whole))
    path = tmp_path / "a.tfrecord"
    path.write_bytes(whole[:keep])
    if keep == len(records[0]):
        assert v1_frames(path) == 1
    else:
        with pytest.raises(ValueError, match=r"a\.tfrecord"):
            v1_frames(path)


@FEW
@given(flips=Flips)
def test_v1_flipped_bits_never_pass(tmp_path: Path, payloads: list[bytes], flips: list[tuple[int, int]]) -> None:
    whole = b"".join(map(record, payloads))
    path = tmp_path / "a.tfrecord"
    path.write_bytes(flipped(whole, flips))
    if path.read_bytes() == whole:  # flipped and flipped back
        return
    with pytest.raises(ValueError, match=r"a\.tfrecord"):
        v1_frames(path)


@FEW
@given(flips=Flips)
def test_v1_contents_that_lie_under_a_right_checksum(
    tmp_path: Path, payloads: list[bytes], flips: list[tuple[int, int]]
) -> None:
    path = tmp_path / "a.tfrecord"
    path.write_bytes(record(flipped(payloads[0], flips)))
    try:
        v1_frames(path)
    except ValueError as error:
        assert "a.tfrecord" in str(error)


@FEW
@given(place=st.integers(0, 2**31), number=st.sampled_from([127, 2**14, 2**31, 2**32 - 1, 2**63, 2**64 - 1]))
def test_v1_huge_numbers(tmp_path: Path, payloads: list[bytes], place: int, number: int) -> None:
    payload = payloads[0]
    place %= len(payload)
    path = tmp_path / "a.tfrecord"
    path.write_bytes(record(payload[:place] + varint(number) + payload[place + 1 :]))
    tracemalloc.start()
    try:
        v1_frames(path)
    except ValueError as error:
        assert "a.tfrecord" in str(error)
    finally:
        assert tracemalloc.get_traced_memory()[1] < MAX_BYTES
        tracemalloc.stop()


@FEW
@given(tag=st.sampled_from(COMPONENTS), flips=Flips, cut=st.none() | st.floats(0, 1, exclude_max=True))
def test_v2_flipped_and_cut(tmp_path: Path, tables: Path, tag: str, flips: list[tuple[int, int]], cut: float | None) -> None:
    root = tmp_path / "v2"
    shutil.rmtree(root, ignore_errors=True)
    shutil.copytree(tables, root, ignore=shutil.ignore_patterns("*.json"))
    path = next((root / tag).glob("*.parquet"))
    data = path.read_bytes()
    path.write_bytes(flipped(data, flips) if cut is None else data[: int(cut * len(data))])
    try:
        for frame in WaymoV2Recording(root):
            for name in frame.rig:
                frame.image(name)
            if frame.lidar is not None:
                frame.lidar.load()
    except (ValueError, FileNotFoundError) as error:
        assert ".parquet" in str(error)
    else:
        assert cut is None


def test_the_undamaged_files_are_fine(tmp_path: Path, drive: Drive, payloads: list[bytes], tables: Path) -> None:
    path = tmp_path / "a.tfrecord"
    path.write_bytes(b"".join(map(record, payloads)))
    assert v1_frames(path) == 2
    assert_same(WaymoV1Recording(path)[1], drive.frames[1])
    assert_same(WaymoV2Recording(tables)[1], drive.frames[1])
