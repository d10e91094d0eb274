"""The index of nuScenes-format tables: every key frame joined beforehand, made once and read record by record.

It lies beside the tables as ``tables.index.records``, or in the cache folder where nothing can be written there, and is made
anew when size or time of a table change, or when it is damaged. Small tables (``SMALL_BYTES``) are read anew at each opening
and their index, the very same bytes, stays in memory, so that small recordings do not fill folders with files. Processes that
open the same tables for the first time at once each make the index; whichever is ready last stays.
"""

from __future__ import annotations

import io
import json
import sqlite3
import uuid
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

from coin3d.datasets.file_span import FileStamp
from coin3d.datasets.index_place import TABLES_SUFFIX, index_places
from coin3d.datasets.json_table import Row
from coin3d.datasets.nuscenes_join import bucket_of, write_joined
from coin3d.datasets.nuscenes_sensors import Sensors
from coin3d.datasets.nuscenes_tables import TABLES
from coin3d.datasets.record_file import RecordFile, RecordWriter
from coin3d.datasets.table_progress import TableProgress, to_stderr

SMALL_BYTES = 8_000_000
_FORMAT = "coin3d nuscenes tables 1"

Stamps = dict[str, list[int]]


class CannotJoinError(OSError):
    """There is no room for temporary files."""


@dataclass(frozen=True)
class Scene:
    """One scene.

    Args:
        name: as the table has it.
        first: position of its first key frame.
        frames: how many it has.
        sweeps: record that lists its LiDAR sweeps, -1 without any.
    """

    name: str
    first: int
    frames: int
    sweeps: int


class TablesIndex:
    """Key frames, calibrations and sweeps of the tables in a folder. May be sent to other processes and used by threads.

    Args:
        folder: with the tables.
        progress: called with a line now and then, when an index is made and that takes long.

    Raises:
        FileNotFoundError: a table is missing.
        ValueError: the tables are damaged.
        OSError: there is no room to join them.
    """

    def __init__(self, folder: Path, progress: Callable[[str], None]) -> None:
        self._folder, self._progress = folder, progress
        self._file = open_or_make(folder, progress)
        head = self._file.head
        self.sensors = Sensors(folder / "sensor.json", frozenset(head["cameras"]), frozenset(head["lidars"]))
        firsts = accumulate((frames for _, frames, _ in head["scenes"]), initial=0)
        self.scenes = [
            Scene(name, first, frames, sweeps) for first, (name, frames, sweeps) in zip(firsts, head["scenes"], strict=False)
        ]
        self.labelled: bool = head["labelled"]
        self.some_filename: str = head["some_filename"]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_progress": to_stderr}  # what a user gave need not be fit to be sent

    def frame(self, position: int) -> Row:
        """A key frame: token, previous, next, data by channel (row, pose, calibration), annotations, velocities."""
        found: Row = self._record(self._file.head["first_frame"] + position)
        return found

    def calibration(self, number: int) -> Row:
        """A calibrated_sensor row."""
        found: Row = self._record(number)
        return found

    def position_of(self, token: str) -> int | None:
        """The position of a sample, if there is one of this token."""
        head = self._file.head
        bucket: dict[str, int] = self._record(head["first_bucket"] + bucket_of(token, head["buckets"]))
        return bucket.get(token)

    def sweeps_between(self, scene: Scene, time_ns: int) -> list[Row]:
        """LiDAR data of a scene later than a time and before the next key frame: time_ns, row, pose or an error, calibration.

        Raises:
            ValueError: a link of some sweep dangles.
        """
        if problem := self._file.head["sweeps_problem"]:
            raise ValueError(problem)
        listed = self._record(scene.sweeps) if scene.sweeps >= 0 else []
        found: list[Row] = []
        for _, number in listed[max(0, bisect_right([start for start, _ in listed], time_ns) - 1) :]:
            for sweep in self._record(number):
                if sweep["time_ns"] > time_ns:
                    if sweep["is_key"]:
                        return found
                    found.append(sweep)
        return found

    def _record(self, number: int) -> Any:
        try:
            return self._file[number]
        except (ValueError, OSError):  # damaged, made anew or deleted since it was opened: what it was made from is still there
            again = open_or_make(self._folder, self._progress, distrust=True)
            if again.head != self._file.head:
                raise ValueError(
                    f"{self._folder}: the tables were changed while they were in use; open the recording again"
                ) from None
            self._file = again
            return again[number]


def open_or_make(folder: Path, progress: Callable[[str], None], distrust: bool = False) -> RecordFile:
    """The index of the tables in a folder: one that is there, or a new one.

    Args:
        folder: with the tables.
        progress: called with a line now and then.
        distrust: read every record of one that is there before it is taken.

    Raises:
        FileNotFoundError: a table is missing.
        ValueError: the tables are damaged, or change while they are read.
        OSError: there is no room to join them.
    """
    stamps = _stamps(folder)
    sizes = {folder / f"{table}.json": size for table, (size, _) in stamps.items()}
    tell = TableProgress(folder, sizes, progress)
    if sum(sizes.values()) < SMALL_BYTES:
        return _in_memory(folder, stamps, tell)
    places = index_places(folder / "tables", TABLES_SUFFIX)
    for place in places:
        known = _good(place, stamps, distrust)
        if known is not None:
            return known
    for place in places:
        if place.is_dir():
            continue
        partial = place.with_name(f"{place.name}.{uuid.uuid4().hex}.part")  # several processes may be at it
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
            file = partial.open("xb")
        except OSError:  # read-only: the next place
            continue
        try:
            with file:
                _write(folder, stamps, file, tell)
            partial.replace(place)
            return RecordFile.open(place)
        except CannotJoinError:
            raise
        except OSError:  # full: the next place
            continue
        finally:
            partial.unlink(missing_ok=True)
    return _in_memory(folder, stamps, tell)


def _in_memory(folder: Path, stamps: Stamps, tell: TableProgress) -> RecordFile:
    buffer = io.BytesIO()
    _write(folder, stamps, buffer, tell)
    return RecordFile.open(buffer.getvalue())


def _write(folder: Path, stamps: Stamps, file: io.BufferedIOBase, tell: TableProgress) -> None:
    writer = RecordWriter(file)
    try:
        head = write_joined(folder, writer, tell)
    except sqlite3.Error as error:
        raise CannotJoinError(
            f"{folder}: the tables could not be joined ({error}); this needs up to half of their size in temporary files; set "
            "SQLITE_TMPDIR to a folder with room"
        ) from error
    if _stamps(folder) != stamps:
        raise ValueError(f"{folder}: the tables were changed while they were read; open the recording again")
    writer.finish(json.dumps({"format": _FORMAT, "stamps": stamps, **head}))


def _stamps(folder: Path) -> Stamps:
    found = {}
    for table in TABLES:
        path = folder / f"{table}.json"
        if not path.is_file():
            raise FileNotFoundError(f"{path}: this table of the recording is missing; copy the whole version folder")
        stamp = FileStamp.of(path)
        found[table] = [stamp.size, stamp.mtime_ns]
    return found


def _good(place: Path, stamps: Stamps, distrust: bool) -> RecordFile | None:
    try:
        file = RecordFile.open(place)
        if not isinstance(file.head, dict) or (file.head.get("format"), file.head.get("stamps")) != (_FORMAT, stamps):
            return None
        for number in range(len(file) if distrust else 0):
            file[number]
    except (OSError, ValueError):
        return None
    return file
