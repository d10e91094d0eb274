"""A file of many JSON records, each read by its number without the others; damage is noticed wherever it is.

``magic | records | start of every record and end of the last, uint64 | head | trailer``. Records and the head are gzip members
of JSON, which brings a CRC-32 of each; a record says its own number. The trailer holds sizes and a CRC-32 of the starts. All
numbers are little-endian.
"""

from __future__ import annotations

import io
import json
import struct
import zlib
from array import array
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from coin3d.datasets.file_span import FileSpan, FileStamp

_MAGIC = b"c3drec1\n"
_TRAILER = struct.Struct("<QQII8s")  # records, bytes of the head, CRC of the starts, CRC of the three before, magic
_GZIP = 31
_LEVEL = 1  # a third larger than the smallest, in a tenth of the time
_MOST_CHARACTERS = 1 << 26


class RecordWriter:
    """Writes records one after the other.

    Args:
        file: at its beginning.
    """

    def __init__(self, file: io.BufferedIOBase) -> None:
        self._file = file
        self._starts = array("Q", [file.write(_MAGIC)])

    def __len__(self) -> int:
        return len(self._starts) - 1

    def add(self, record: str) -> int:
        """Add a record, given as JSON; its number.

        Raises:
            ValueError: a record of more than 64 million characters.
        """
        number = len(self)
        self._starts.append(self._starts[-1] + self._file.write(_pack(f"[{number},{record}]")))
        return number

    def finish(self, head: str) -> None:
        """Write what is read when the file is opened, given as JSON."""
        starts = np.array(self._starts, dtype="<u8").tobytes()
        packed = _pack(head)
        numbers = struct.pack("<QQI", len(self), len(packed), zlib.crc32(starts))
        self._file.write(starts + packed)
        self._file.write(_TRAILER.pack(len(self), len(packed), zlib.crc32(starts), zlib.crc32(numbers), _MAGIC))


@dataclass(frozen=True, eq=False)
class RecordFile:
    """Records by number. Nothing stays open, so it may be sent to other processes and used by several threads.

    Args:
        source: the file as it was when it was opened, or all of its bytes.
        starts: of the records, and the end of the last.
        head: what the file says about itself.
    """

    source: FileSpan | bytes
    starts: Int[np.ndarray, "n"]
    head: Any

    @classmethod
    def open(cls, source: Path | bytes) -> RecordFile:
        """Read the head and where the records are.

        Raises:
            FileNotFoundError: no such file.
            ValueError: not such a file, or a damaged one.
        """
        if isinstance(source, Path):
            stamp = FileStamp.of(source)
            content: FileSpan | bytes = FileSpan(source, stamp, 0, stamp.size)
            size = stamp.size
        else:
            content, size = source, len(source)
        end = size - _TRAILER.size
        if end < len(_MAGIC):
            raise ValueError("too short for a file of records")
        trailer = _read(content, end, size)
        count, head_bytes, starts_crc, numbers_crc, magic = _TRAILER.unpack(trailer)
        if magic != _MAGIC or zlib.crc32(struct.pack("<QQI", count, head_bytes, starts_crc)) != numbers_crc:
            raise ValueError("the end of the file is damaged")
        first = end - head_bytes - 8 * (count + 1)
        if first < len(_MAGIC):
            raise ValueError("the file is damaged: it is shorter than its records")
        tail = _read(content, first, end)
        starts = tail[: 8 * (count + 1)]
        if zlib.crc32(starts) != starts_crc:
            raise ValueError("the places of the records are damaged")
        return cls(content, np.frombuffer(starts, dtype="<u8").astype(np.int64), _unpack(tail[8 * (count + 1) :]))

    def __len__(self) -> int:
        return len(self.starts) - 1

    def __getitem__(self, number: int) -> Any:
        """A record.

        Raises:
            IndexError: no such number.
            FileNotFoundError: the file is gone.
            ValueError: the file was changed since, or the record is damaged.
        """
        if not 0 <= number < len(self):
            raise IndexError(f"record {number} of {len(self)}")
        found = _unpack(_read(self.source, int(self.starts[number]), int(self.starts[number + 1])))
        if not isinstance(found, list) or len(found) != 2 or found[0] != number:
            raise ValueError(f"record {number} is damaged: another one is in its place")
        return found[1]


def _read(source: FileSpan | bytes, start: int, end: int) -> bytes:
    return source[start:end] if isinstance(source, bytes) else source.within(start, end).read()


def _pack(text: str) -> bytes:
    if len(text) > _MOST_CHARACTERS:
        raise ValueError(f"a record of {len(text)} characters is too long")
    return zlib.compress(text.encode("ascii"), _LEVEL, wbits=_GZIP)


def _unpack(packed: bytes) -> Any:
    inflate = zlib.decompressobj(_GZIP)
    try:
        text = inflate.decompress(packed, _MOST_CHARACTERS)
        if not inflate.eof or inflate.unused_data:
            raise ValueError("it does not end where it should")
        return json.loads(text)
    except (zlib.error, ValueError, RecursionError) as error:
        raise ValueError(f"damaged: {error}") from error
