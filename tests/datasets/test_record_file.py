"""Files of records: each comes back by its number, and no damage passes for a record."""

from __future__ import annotations

import io
import json
import pickle
import struct
import zlib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from coin3d.datasets.record_file import RecordFile, RecordWriter

RECORDS = [{"a": [1, 2.5, None]}, "é\ud800", [], 7]
JSON = st.recursive(st.none() | st.integers() | st.text(), lambda s: st.lists(s) | st.dictionaries(st.text(), s), max_leaves=8)


def written(records: list[Any], head: Any = None) -> bytes:
    buffer = io.BytesIO()
    writer = RecordWriter(buffer)
    assert [writer.add(json.dumps(record)) for record in records] == list(range(len(records)))
    writer.finish(json.dumps(head))
    return buffer.getvalue()


@settings(max_examples=30)
@given(records=st.lists(JSON, max_size=5), head=JSON)
def test_what_is_written_comes_back(records: list[Any], head: Any) -> None:
    file = RecordFile.open(written(records, head))
    assert len(file) == len(records) and file.head == head
    assert [file[i] for i in reversed(range(len(file)))] == records[::-1]


def test_the_layout_is_the_documented_one() -> None:
    data = written(RECORDS, {"x": 1})
    count, head_bytes, *_ = struct.unpack("<QQII8s", data[-32:])
    assert (count, data[:8], data[-8:]) == (4, b"c3drec1\n", b"c3drec1\n")
    head_start = len(data) - 32 - head_bytes
    starts = struct.unpack("<5Q", data[head_start - 40 : head_start])
    assert starts[0] == 8 and starts[-1] == head_start - 40
    assert json.loads(zlib.decompress(data[starts[2] : starts[3]], 31)) == [2, []]
    assert json.loads(zlib.decompress(data[head_start:-32], 31)) == {"x": 1}


def test_in_a_file_and_in_other_processes(tmp_path: Path) -> None:
    path = tmp_path / "a.records"
    path.write_bytes(written(RECORDS))
    file = pickle.loads(pickle.dumps(RecordFile.open(path)))
    assert [file[i] for i in range(4)] == RECORDS
    for number in (-1, 4):
        with pytest.raises(IndexError, match=f"record {number} of 4"):
            file[number]
    path.write_bytes(written(RECORDS[:2]))
    with pytest.raises(ValueError, match=r"a\.records: the file was changed"):
        file[0]
    path.unlink()
    with pytest.raises(FileNotFoundError, match=r"a\.records"):
        file[0]


@settings(max_examples=60, suppress_health_check=[HealthCheck.too_slow])
@given(place=st.integers(0, 10**6), bit=st.integers(0, 7), cut=st.booleans())
def test_damage_never_passes(place: int, bit: int, cut: bool) -> None:
    data = bytearray(written(RECORDS, {"x": 1}))
    place %= len(data)
    if cut:
        del data[place:]
    else:
        data[place] ^= 1 << bit
    try:
        file = RecordFile.open(bytes(data))
    except ValueError:
        return
    assert not cut and len(file) == 4 and file.head == {"x": 1}
    for i, record in enumerate(RECORDS):
        try:
            assert file[i] == record
        except ValueError as error:
            assert "damaged" in str(error)


@pytest.mark.parametrize("count", [0, 1, 2**32, 2**61 - 1, 2**64 - 1])
@pytest.mark.parametrize("head_bytes", [0, 2**32, 2**64 - 1])
def test_huge_counts_under_a_right_checksum(count: int, head_bytes: int) -> None:
    numbers = struct.pack("<QQI", count, head_bytes, 0)
    trailer = numbers + struct.pack("<I8s", zlib.crc32(numbers), b"c3drec1\n")
    with pytest.raises(ValueError, match="damaged"):
        RecordFile.open(written(RECORDS)[:-32] + trailer)
