"""TFRecord files: one record after another, each framed by its length and two checksums.

A record is its length in 8 bytes, the masked CRC-32C of these bytes, the payload, and its masked CRC-32C, little endian.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

from coin3d.datasets.crc32c import masked_crc32c
from coin3d.datasets.file_span import FileSpan, FileStamp

_LENGTH = struct.Struct("<Q")
_CHECKSUM = struct.Struct("<I")
_HEADER_BYTES = _LENGTH.size + _CHECKSUM.size
_MAX_RECORD_BYTES = 1 << 28
"""Larger than any frame of cameras and LiDAR by a factor of ten or more."""


def record_spans(path: Path) -> Iterator[FileSpan]:
    """Where the payloads are, in order. Lengths are checked against their checksums, payloads are not read.

    Raises:
        FileNotFoundError: no such file.
        ValueError: a length with a wrong checksum, or a record that the file ends within.
    """
    stamp = FileStamp.of(path)
    start, number = 0, 0
    with path.open("rb") as file:
        while start < stamp.size:
            where = f"{path}: record {number} at byte {start}"
            file.seek(start)
            header = file.read(_HEADER_BYTES)
            if len(header) < _HEADER_BYTES:
                raise ValueError(f"{where}: the file ends within its header; it is truncated, copy it again")
            (length,) = _LENGTH.unpack_from(header)
            if masked_crc32c(header[: _LENGTH.size]) != _CHECKSUM.unpack_from(header, _LENGTH.size)[0]:
                raise ValueError(
                    f"{where}: the checksum of its length is wrong: the file is damaged, compressed, or no TFRecord file; "
                    "copy it again"
                )
            if start + _HEADER_BYTES + length + _CHECKSUM.size > stamp.size:
                raise ValueError(f"{where}: {length} bytes long, but the file ends before; it is truncated, copy it again")
            if length > _MAX_RECORD_BYTES:
                raise ValueError(f"{where}: {length} bytes long; frames are below {_MAX_RECORD_BYTES}")
            yield FileSpan(path, stamp, start + _HEADER_BYTES, length)
            start += _HEADER_BYTES + length + _CHECKSUM.size
            number += 1


def read_payload(span: FileSpan) -> bytes:
    """The payload of a record, checked.

    Raises:
        FileNotFoundError: the file is gone.
        ValueError: the file was changed, or the checksum is wrong.
    """
    record = FileSpan(span.path, span.stamp, span.start, span.length + _CHECKSUM.size).read()
    payload = record[: span.length]
    if masked_crc32c(payload) != _CHECKSUM.unpack_from(record, span.length)[0]:
        raise ValueError(
            f"{span.path}: record at byte {span.start - _HEADER_BYTES}: the checksum of its content is wrong: the file is "
            "damaged; copy it again"
        )
    return payload
