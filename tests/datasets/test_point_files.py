"""LiDAR files of own recordings: .bin, .npy and the three kinds of .pcd, built byte by byte."""

from __future__ import annotations

import struct
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coin3d.datasets.lzf import lzf_decompress
from coin3d.datasets.pcd_file import read_pcd
from coin3d.datasets.point_file import PointFile
from coin3d.geometry import Pose

HERE = Pose.identity()
HEADER = """# .PCD v0.7
VERSION 0.7
FIELDS x y z ring intensity
SIZE 4 4 8 2 1
TYPE F F F U I
COUNT 1 1 1 2 1
WIDTH 2
HEIGHT 1
VIEWPOINT 9 9 9 1 0 0 0
POINTS 2
DATA {data}
"""
# two points: (1.5, -2, 3) with rings 7 8 and intensity -4; (nan, 0, 0) with rings 0 1 and intensity 5
ROWS = struct.pack("<ffdHHb", 1.5, -2, 3, 7, 8, -4) + struct.pack("<ffdHHb", np.nan, 0, 0, 0, 1, 5)
FIELDS = (
    struct.pack("<ff", 1.5, np.nan) + struct.pack("<ff", -2, 0) + struct.pack("<dd", 3, 0)
    + struct.pack("<HHHH", 7, 8, 0, 1) + struct.pack("<bb", -4, 5)
)  # fmt: skip


def literals(data: bytes) -> bytes:
    """An LZF stream without copies."""
    return b"".join(bytes([len(data[i : i + 32]) - 1]) + data[i : i + 32] for i in range(0, len(data), 32))


def pcd(path: Path, kind: str, body: bytes) -> Path:
    path.write_bytes(HEADER.format(data=kind).encode() + body)
    return path


def bodies() -> dict[str, bytes]:
    packed = literals(FIELDS)
    return {
        "ascii": b"1.5 -2 3 7 8 -4\nnan 0 0 0 1 5\n",
        "binary": ROWS,
        "binary_compressed": struct.pack("<II", len(packed), len(FIELDS)) + packed,
    }


@pytest.mark.parametrize("kind", ["ascii", "binary", "binary_compressed"])
def test_the_three_kinds_of_pcd_hold_the_same(tmp_path: Path, kind: str) -> None:
    path = pcd(tmp_path / "a.pcd", kind, bodies()[kind])
    fields = read_pcd(path)
    assert list(fields) == ["x", "y", "z", "intensity"], "ring has two numbers per point and cannot be a column"
    assert fields["intensity"].tolist() == [-4, 5] and fields["x"][0] == 1.5
    scan = PointFile(path, Pose(np.eye(3), np.array([1.0, 0, 2]))).load()
    np.testing.assert_allclose(scan.points_ego, [[2.5, -2, 5]])
    assert scan.intensity.tolist() == [-4] and scan.origin_ego.tolist() == [1, 0, 2]


@pytest.mark.parametrize("kind", ["ascii", "binary", "binary_compressed"])
def test_every_truncated_pcd_is_an_error(tmp_path: Path, kind: str) -> None:
    whole = pcd(tmp_path / "a.pcd", kind, bodies()[kind]).read_bytes()
    # the last digit and the last line end of ascii data can be lost without a trace
    for length in range(0, len(whole) - (2 if kind == "ascii" else 0), 3):
        (tmp_path / "a.pcd").write_bytes(whole[:length])
        with pytest.raises(ValueError, match=r"a\.pcd: not a complete PCD file"):
            read_pcd(tmp_path / "a.pcd")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("POINTS 2", "POINTS 999999999999"), "points"),
        (("POINTS 2", "POINTS -2"), "POINTS -2"),
        (("POINTS 2", "POINTS two"), "invalid literal"),
        (("SIZE 4 4 8 2 1", "SIZE 4 4 8 2"), "differ in length"),
        (("SIZE 4 4 8 2 1", "SIZE 4 4 3 2 1"), "field z is of TYPE F, SIZE 3"),
        (("COUNT 1 1 1 2 1", "COUNT 1 1 1 0 1"), "COUNT 0"),
        (("FIELDS x y z", "FIELDS x x z"), "two fields have one name"),
        (("DATA binary", "DATA zipped"), "DATA zipped; known are ascii"),
        (("FIELDS x y z ring intensity\n", ""), "no line FIELDS"),
    ],
)
def test_headers_that_make_no_sense(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    path = tmp_path / "a.pcd"
    path.write_bytes(HEADER.format(data="binary").replace(*change).encode() + ROWS)
    with pytest.raises(ValueError, match=rf"a\.pcd: not a complete PCD file: .*{message}"):
        read_pcd(path)


def test_a_compressed_pcd_that_announces_gigabytes_is_refused_before_memory_is_taken(tmp_path: Path) -> None:
    header = HEADER.format(data="binary_compressed").replace("POINTS 2", "POINTS 200000000").encode()
    (tmp_path / "a.pcd").write_bytes(header + struct.pack("<II", 8, 4_200_000_000) + bytes(8))
    with pytest.raises(ValueError, match="8 compressed bytes cannot become 4200000000"):
        read_pcd(tmp_path / "a.pcd")


def test_lzf_by_hand() -> None:
    assert lzf_decompress(b"\x02abc", 3) == b"abc"
    # copy of 3 (1 + 2) from distance 3, then of 9 + 1 from distance 1: the control byte of a long copy has length 7 + next
    assert lzf_decompress(b"\x02abc" + bytes([1 << 5, 2]), 6) == b"abcabc"
    assert lzf_decompress(b"\x00z" + bytes([7 << 5, 2, 0]), 12) == b"z" * 12
    assert lzf_decompress(b"\x01xy" + bytes([3 << 5, 1]), 7) == b"xyxyxyx"
    assert lzf_decompress(b"", 0) == b""


@pytest.mark.parametrize(
    ("stream", "size", "message"),
    [
        (b"\x02ab", 3, "end within literal bytes"),
        (b"\x00a" + bytes([1 << 5]), 4, "end within a copy"),
        (b"\x00a" + bytes([1 << 5, 5]), 4, "starts before the beginning"),
        (b"\x02abc", 2, "give more than 2 bytes"),
        (b"\x02abc", 4, "give 3 bytes, not 4"),
    ],
)
def test_damaged_lzf(stream: bytes, size: int, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        lzf_decompress(stream, size)


@given(st.binary(max_size=200), st.integers(0, 400))
def test_lzf_never_gives_anything_but_the_announced_size(stream: bytes, size: int) -> None:
    with suppress(ValueError):
        assert len(lzf_decompress(stream, size)) == size


@given(st.binary(max_size=120))
def test_literals_come_back(data: bytes) -> None:
    assert lzf_decompress(literals(data), len(data)) == data


def test_bin_and_npy_with_named_columns(tmp_path: Path) -> None:
    points = np.array([[1, 2, 3, 0.5], [4, 5, np.inf, 0.5]])
    points.astype("<f4").tofile(tmp_path / "a.bin")
    np.save(tmp_path / "a.npy", points[:, [3, 0, 1, 2]])
    for scan in (
        PointFile(tmp_path / "a.bin", HERE, ("x", "y", "z", "intensity")).load(),
        PointFile(tmp_path / "a.npy", HERE, ("intensity", "x", "y", "z")).load(),
    ):
        assert scan.points_ego.tolist() == [[1, 2, 3]] and scan.intensity.tolist() == [0.5]
    assert PointFile(tmp_path / "a.bin", HERE, ("x", "y", "z", "t")).load().intensity.tolist() == [0]


def test_files_that_are_not_of_the_announced_columns(tmp_path: Path) -> None:
    np.zeros((7, 4), dtype="<f4").tofile(tmp_path / "a.bin")
    with pytest.raises(ValueError, match=r"a\.bin: 112 bytes are not a whole number of points of 20 bytes"):
        PointFile(tmp_path / "a.bin", HERE, ("x", "y", "z", "intensity", "ring")).load()
    xyz = ("x", "y", "z")
    np.save(tmp_path / "a.npy", np.zeros((5, 4)))
    with pytest.raises(ValueError, match=r"shape \(points, 3\) is expected for x, y, z, got float64 with shape \(5, 4\)"):
        PointFile(tmp_path / "a.npy", HERE, xyz).load()
    np.save(tmp_path / "a.npy", np.array([[None] * 3]), allow_pickle=True)
    with pytest.raises(ValueError, match=r"a\.npy: not a complete NumPy array"):
        PointFile(tmp_path / "a.npy", HERE, xyz).load()
    np.save(tmp_path / "a.npy", np.zeros((5, 3)))
    whole = (tmp_path / "a.npy").read_bytes()
    for damaged in (whole[:-1], whole[:40], b"", whole.replace(b"(5, 3)", b"(5000000000000, 3)")):
        (tmp_path / "a.npy").write_bytes(damaged)
        with pytest.raises(ValueError, match=r"a\.npy: not a complete NumPy array"):
            PointFile(tmp_path / "a.npy", HERE, xyz).load()
    with pytest.raises(ValueError, match=r"b\.npy: the LiDAR file is missing"):
        PointFile(tmp_path / "b.npy", HERE, xyz).load()
    with pytest.raises(ValueError, match="PCD files name their own columns"):
        PointFile(tmp_path / "b.pcd", HERE, xyz)


@given(st.data())
def test_bit_flips_in_pcd_files_never_crash(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    kind = data.draw(st.sampled_from(["ascii", "binary", "binary_compressed"]))
    path = pcd(tmp_path_factory.mktemp("fuzz") / "a.pcd", kind, bodies()[kind])
    damaged = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    path.write_bytes(damaged)
    try:
        fields = read_pcd(path)
    except ValueError as error:
        assert str(path) in str(error)
    else:
        assert len({len(column) for column in fields.values()}) <= 1
