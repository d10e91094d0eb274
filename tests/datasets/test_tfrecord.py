"""Records of a TFRecord file: whole, cut short, damaged."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from coin3d.datasets.file_span import FileSpan
from coin3d.datasets.tfrecord import read_payload, record_spans
from waymo_writer import masked_crc, record

PAYLOADS = [b"first", b"", bytes(100)]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "a.tfrecord"
    path.write_bytes(b"".join(map(record, PAYLOADS)))
    return path


def test_records_come_in_order(path: Path) -> None:
    spans = list(record_spans(path))
    assert [(s.start, s.length) for s in spans] == [(12, 5), (12 + 5 + 16, 0), (12 + 5 + 16 + 16, 100)]
    assert [read_payload(span) for span in spans] == PAYLOADS


def test_a_file_cut_anywhere_is_an_error_but_between_records(path: Path) -> None:
    whole = path.read_bytes()
    ends = [0, 21, 37, len(whole)]
    for cut in range(len(whole)):
        path.write_bytes(whole[:cut])
        if cut in ends:
            assert len(list(record_spans(path))) == ends.index(cut)
        else:
            with pytest.raises(ValueError, match=r"a\.tfrecord: record \d at byte \d+: .*truncated, copy it again"):
                list(record_spans(path))


def test_every_flipped_bit_is_found(path: Path) -> None:
    whole = path.read_bytes()
    for bit in range(0, 8 * len(whole), 11):  # every part of every record, every bit of a byte
        damaged = bytearray(whole)
        damaged[bit // 8] ^= 1 << bit % 8
        path.write_bytes(bytes(damaged))
        with pytest.raises(ValueError, match=r"checksum of its (length|content) is wrong"):
            for span in record_spans(path):
                read_payload(span)


def test_absurd_lengths_cost_nothing(path: Path) -> None:
    for length in (2**40, 2**64 - 1):
        header = struct.pack("<Q", length)
        path.write_bytes(header + struct.pack("<I", masked_crc(header)) + b"abc")
        with pytest.raises(ValueError, match=rf"record 0 at byte 0: {length} bytes long, but the file ends before"):
            list(record_spans(path))


def test_a_file_that_changed_is_not_read_on(path: Path) -> None:
    span = next(record_spans(path))
    path.write_bytes(path.read_bytes() + record(b"more"))
    with pytest.raises(ValueError, match="changed while it was in use"):
        read_payload(span)
    path.unlink()
    with pytest.raises(FileNotFoundError, match=r"a\.tfrecord: this file"):
        read_payload(span)


def test_spans_stay_inside(path: Path) -> None:
    span = list(record_spans(path))[2]
    assert span.within(2, 6).read() == bytes(4)
    with pytest.raises(ValueError, match="of a range of 100"):
        span.within(5, 101)
    with pytest.raises(ValueError, match="cut short"):
        FileSpan(span.path, span.stamp, span.start, 10_000)
