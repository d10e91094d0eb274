"""Recordings of the Waymo Open Dataset, version 1: TFRecord files with one frame per record."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import BinaryIO

from coin3d.datasets.file_span import FileSpan, FileStamp
from coin3d.datasets.frame import Frame
from coin3d.datasets.frame_index import indexed
from coin3d.datasets.protobuf_wire import Message, read_field
from coin3d.datasets.tfrecord import read_payload, record_spans
from coin3d.datasets.waymo_parts import checked_segment, checked_timestamp, token
from coin3d.datasets.waymo_v1_frame import CONTEXT, CONTEXT_NAME, LABELS, TIMESTAMP, read_frame

SUFFIX = ".tfrecord"
_MAX_CONTEXT_BYTES = 1 << 24
_MAX_TAG_AND_LENGTH_BYTES = 20


@dataclass(frozen=True)
class RecordEntry:
    """What the index of a file knows of a record.

    Args:
        start: first byte of the payload.
        length: of the payload in bytes.
        segment: name of the sequence.
        timestamp_us: of the frame.
        labelled: whether it has annotated boxes.
    """

    start: int
    length: int
    segment: str
    timestamp_us: int
    labelled: bool

    def __post_init__(self) -> None:
        if not all(type(value) is int and value >= 0 for value in (self.start, self.length)):
            raise ValueError(f"a record at {self.start} of {self.length} bytes")
        checked_segment(self.segment, "index")
        checked_timestamp(self.timestamp_us, "index")


class WaymoV1Recording:
    """Frames of all segments, by name of the segment and time. Files are read frame by frame, images when asked for.

    The reference time and ego frame of a frame are those of ``Frame.pose``, which labels are given in. Every image has a pose
    of its own, so a camera sits where the vehicle was when it fired (``time_sync = pose``).

    Args:
        root: a TFRecord file, or a folder that holds such files or folders of them.
        split: name of the one folder in ``root`` to open; all by default.
        second_return: whether LiDAR sweeps hold the second returns of the light as well.

    Raises:
        FileNotFoundError: no TFRecord files.
        ValueError: a file is damaged, or two files hold the same frame.
    """

    def __init__(self, root: Path | str, split: str | None = None, second_return: bool = False) -> None:
        root = Path(root)
        self.root = root if root.is_dir() else root.parent
        self.second_return = second_return
        found: dict[tuple[str, int], tuple[Path, FileStamp, RecordEntry]] = {}
        for path in _files(root, split):
            stamp = FileStamp.of(path)
            for entry in indexed(path, RecordEntry, partial(_entries, path)):
                other = found.setdefault((entry.segment, entry.timestamp_us), (path, stamp, entry))
                if other[2] is not entry:
                    raise ValueError(
                        f"{path}: holds the frame {token(entry.segment, entry.timestamp_us)} that is in {other[0]} as well; "
                        "remove one of the copies"
                    )
        if not found:
            raise ValueError(f"{root}: the TFRecord files hold no frames; were they copied whole?")
        self._frames = [found[key] for key in sorted(found)]
        self._labelled = {entry.segment for _, _, entry in self._frames if entry.labelled}

    def __len__(self) -> int:
        return len(self._frames)

    def __iter__(self) -> Iterator[Frame]:
        return (self[i] for i in range(len(self)))

    def scene_names(self) -> list[str]:
        """The scene of every frame, without building frames."""
        return [entry.segment for _, _, entry in self._frames]

    def __getitem__(self, index: int) -> Frame:
        """The frame at a position. Its record is read and its checksum verified.

        Raises:
            IndexError: beyond the end.
            ValueError: the record is damaged, its file was changed, or a part of it makes no sense.
        """
        index = range(len(self))[index]
        path, stamp, entry = self._frames[index]
        where = f"{path}: frame {entry.timestamp_us} (record at byte {entry.start})"
        span = FileSpan(path, stamp, entry.start, entry.length)
        instant = read_frame(read_payload(span), span, entry.segment in self._labelled, where)
        if (instant.segment, instant.timestamp_us) != (entry.segment, entry.timestamp_us):
            raise ValueError(f"{where}: the index of this file is outdated; delete {path.name}.index.json")
        return instant.frame(self._token(index - 1, entry), self._token(index + 1, entry), self.root, self.second_return)

    def _token(self, index: int, neighbour: RecordEntry) -> str:
        """Token of the frame at a position, or "" where another segment begins."""
        if not 0 <= index < len(self._frames) or self._frames[index][2].segment != neighbour.segment:
            return ""
        return token(neighbour.segment, self._frames[index][2].timestamp_us)


def is_waymo_v1(path: Path) -> bool:
    """Whether this is a TFRecord file or a folder that holds some."""
    if path.is_file():
        return path.suffix == SUFFIX
    return any(next(path.glob(pattern), None) for pattern in (f"*{SUFFIX}", f"*/*{SUFFIX}"))


def _files(root: Path, split: str | None) -> list[Path]:
    if root.is_file():
        return [root]
    if split is None:
        found = sorted((*root.glob(f"*{SUFFIX}"), *root.glob(f"*/*{SUFFIX}")))
    else:
        found = sorted((root / split).glob(f"*{SUFFIX}")) if Path(split).name == split else []
    if not found:
        raise FileNotFoundError(f"{root if split is None else root / split}: no {SUFFIX} files there")
    return found


def _entries(path: Path) -> list[RecordEntry]:
    with path.open("rb") as file:
        return [_entry(file, span, f"{path}: record {i}") for i, span in enumerate(record_spans(path))]


def _entry(file: BinaryIO, span: FileSpan, where: str) -> RecordEntry:
    """Walk over the fields of a record, from header to header, until all is known: images and points are not read."""
    segment, timestamp_us, at = None, None, 0
    labelled = False
    while at < span.length and not (segment and timestamp_us and labelled):
        file.seek(span.start + at)
        piece = file.read(min(_MAX_TAG_AND_LENGTH_BYTES, span.length - at))
        field = read_field(piece, 0, len(piece), where, span.length - at)
        if field.number == CONTEXT:
            if field.end - field.start > _MAX_CONTEXT_BYTES:
                raise ValueError(f"{where}: a context of {field.end - field.start} bytes; it is damaged")
            file.seek(span.start + at + field.start)
            context = Message(file.read(field.end - field.start), f"{where}: context")
            segment = context.text(CONTEXT_NAME, "name of the segment")
        elif field.number == TIMESTAMP:
            timestamp_us = field.value
        labelled |= field.number == LABELS
        at += field.end
    return RecordEntry(
        span.start, span.length, checked_segment(segment, where), checked_timestamp(timestamp_us, where), labelled
    )
