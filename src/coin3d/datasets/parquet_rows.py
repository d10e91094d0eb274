"""Rows of Parquet files, a few at a time: only the columns and row groups that are asked for are read.

Reading goes through pyarrow, which is installed with the extra ``waymo``.
"""

from __future__ import annotations

import os
import threading
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from coin3d.datasets.file_span import FileStamp

FEW = 5
"""Rows at a time of columns with images or range images in them."""

MANY = 65_536
"""Rows at a time of columns of plain numbers."""

_OPEN_READERS = 16
_MAX_ROWS = 10_000_000
_READ_BUFFER_BYTES = 1 << 20


@dataclass(frozen=True)
class TableFile:
    """A Parquet file as it was when it was opened first."""

    path: Path
    stamp: FileStamp

    @classmethod
    def at(cls, path: Path) -> TableFile:
        """The file as it is now; raises FileNotFoundError."""
        return cls(path, FileStamp.of(path))


@dataclass(frozen=True)
class RowPlace:
    """Where a row is: number of its row group, and number within that."""

    group: int
    row: int


class Row:
    """Values of one row by the names of their columns. Raises ValueError for a value of another kind than asked for."""

    def __init__(self, values: Mapping[str, Any], where: str) -> None:
        self._values, self.where = values, where

    def has(self, column: str) -> bool:
        """Whether there is such a column, with something in it."""
        return column in self._values and bool(self._values[column].is_valid)

    def real(self, column: str, default: float | None = None) -> float:
        """A number; ``default``, if there is one, where it is missing."""
        value = self._plain(column) if self.has(column) or default is None else default
        if not isinstance(value, (int, float)):
            raise ValueError(f"{self.where}: {column} is {_short(value)} where a number is expected")
        return float(value)

    def whole(self, column: str, default: int | None = None) -> int:
        """A whole number; ``default``, if there is one, where it is missing."""
        value = self.real(column, default)
        if not value.is_integer() or abs(value) > 2**53:
            raise ValueError(f"{self.where}: {column} is {value} where a whole number is expected")
        return int(value)

    def text(self, column: str) -> str:
        """A string, "" where it is missing."""
        value = self._plain(column) if self.has(column) else ""
        if not isinstance(value, str):
            raise ValueError(f"{self.where}: {column} is {_short(value)} where a string is expected")
        return value

    def content(self, column: str) -> bytes:
        """A string of bytes."""
        value = self._plain(column)
        if not isinstance(value, bytes):
            raise ValueError(f"{self.where}: {column} is {_short(value)} where bytes are expected")
        return value

    def numbers(self, column: str) -> Float[np.ndarray, "n"]:
        """A list of numbers, empty where it is missing."""
        if not self.has(column):
            return np.zeros(0)
        items = getattr(self._values[column], "values", None)
        if items is None:
            raise ValueError(f"{self.where}: {column} is {_short(self._plain(column))} where a list of numbers is expected")
        try:
            found = np.asarray(items.to_numpy(zero_copy_only=False))
            return found if found.dtype in (np.float32, np.float64) else found.astype(np.float64)
        except (ValueError, TypeError) as error:
            raise ValueError(f"{self.where}: {column} is no list of numbers ({error})") from error

    def _plain(self, column: str) -> Any:
        if column not in self._values:
            raise ValueError(f"{self.where}: has no column {column}")
        try:
            return self._values[column].as_py()
        except ValueError as error:  # text that is none
            raise ValueError(f"{self.where}: {column} cannot be read ({error})") from error


@dataclass(frozen=True, eq=False)
class RowKeys:
    """What rows of a table are found by.

    Args:
        keys: (N, K) whole numbers, one row per row of the table.
        group: row group of every row.
        row: its number within that.
    """

    keys: Int[np.ndarray, "n k"]
    group: Int[np.ndarray, "n"]
    row: Int[np.ndarray, "n"]

    def places(self, first_key: int | None = None) -> list[tuple[tuple[int, ...], RowPlace]]:
        """Keys and places of the rows with this first key, of all rows without."""
        chosen = np.arange(len(self.row)) if first_key is None else np.flatnonzero(self.keys[:, 0] == first_key)
        return [(tuple(self.keys[i].tolist()), RowPlace(int(self.group[i]), int(self.row[i]))) for i in chosen]


@lru_cache(maxsize=64)
def row_keys(table: TableFile, *names: str) -> RowKeys:
    """The key columns of a table. Nothing else is read.

    Raises:
        FileNotFoundError: the file is gone.
        ValueError: the file is damaged, was changed, or lacks a column.
        ImportError: pyarrow is not installed.
    """
    _present(table, names, ())
    file = _open(table)
    if file.metadata.num_rows > _MAX_ROWS:
        raise ValueError(f"{table.path}: {file.metadata.num_rows} rows; the file is damaged")
    keys, group, row = [np.zeros((0, len(names)), np.int64)], [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for number in range(file.metadata.num_row_groups):
        with _located(table.path):
            columns = file.read_row_group(number, columns=list(names), use_threads=False)
            found = [columns.column(name).to_numpy() for name in names]
        if any(column.dtype.kind not in "iu" for column in found):
            raise ValueError(f"{table.path}: row group {number}: {', '.join(names)} are no whole numbers, or missing in a row")
        keys.append(np.stack(found, axis=-1).astype(np.int64))
        group.append(np.full(len(found[0]), number))
        row.append(np.arange(len(found[0])))
    return RowKeys(np.concatenate(keys), np.concatenate(group), np.concatenate(row))


def read_rows(
    table: TableFile, places: Sequence[RowPlace], columns: Sequence[str], batch: int, optional: Sequence[str] = ()
) -> list[Row]:
    """Some rows of a file.

    Reading forward is cheap: the file is kept open where the last rows were. A row group is gone through in batches, so no
    more than a few of them are in memory.

    Args:
        table: the file.
        places: the rows, in any order.
        columns: what to read of them.
        batch: rows at a time, ``FEW`` or ``MANY``.
        optional: further columns, which may be missing.

    Raises:
        FileNotFoundError: the file is gone.
        ValueError: the file is damaged, was changed, or lacks a column.
        ImportError: pyarrow is not installed.
    """
    names = _present(table, tuple(columns), tuple(optional))
    with _lock:
        return [_cursor(table, place.group, names, batch).row(place.row) for place in places]


def parquet() -> ModuleType:
    """The module that reads Parquet.

    Raises:
        ImportError: it is not installed.
    """
    try:
        import pyarrow.parquet
    except ImportError as error:
        raise ImportError("Parquet files (Waymo v2) are read with pyarrow: pip install 'coin3d[waymo]'") from error
    module: ModuleType = pyarrow.parquet
    return module


class _Cursor:
    """Goes through one row group from front to back and remembers the last two batches."""

    def __init__(self, table: TableFile, group: int, columns: tuple[str, ...], batch: int) -> None:
        self._table, self._group, self._columns, self._batch = table, group, columns, batch
        self._kept: OrderedDict[int, Any] = OrderedDict()  # first row -> batch
        self._rewind()

    def row(self, row: int) -> Row:
        where = f"{self._table.path}: row {row} of row group {self._group}"
        if self._kept and row < next(iter(self._kept)):
            self._rewind()
        while True:
            for start, batch in self._kept.items():
                if start <= row < start + batch.num_rows:
                    return Row({name: batch.column(name)[row - start] for name in batch.schema.names}, where)
            with _located(self._table.path):
                batch = next(self._batches, None)
            if batch is None or not batch.num_rows:
                raise ValueError(f"{where}: the row group has only {self._next} rows")
            self._kept[self._next] = batch
            self._next += batch.num_rows
            while len(self._kept) > 2:
                self._kept.popitem(last=False)

    def _rewind(self) -> None:
        self._kept.clear()
        self._next = 0
        file = _open(self._table, pre_buffer=False, buffer_size=_READ_BUFFER_BYTES)
        with _located(self._table.path):
            self._batches: Iterator[Any] = file.iter_batches(
                self._batch, row_groups=[self._group], columns=list(self._columns), use_threads=False
            )


_lock = threading.Lock()
_cursors: OrderedDict[tuple[Any, ...], _Cursor] = OrderedDict()


def _cursor(table: TableFile, group: int, columns: tuple[str, ...], batch: int) -> _Cursor:
    key = (os.getpid(), table, group, columns, batch)  # a forked process must not go on with its parent's
    cursor = _cursors.pop(key, None) or _Cursor(table, group, columns, batch)
    _cursors[key] = cursor
    while len(_cursors) > _OPEN_READERS:
        _cursors.popitem(last=False)
    return cursor


@lru_cache(maxsize=256)
def _present(table: TableFile, columns: tuple[str, ...], optional: tuple[str, ...]) -> tuple[str, ...]:
    names = set(_open(table).schema_arrow.names)
    if missing := [name for name in columns if name not in names]:
        raise ValueError(f"{table.path}: has no column {', '.join(missing)}; is it a file of another component?")
    return (*columns, *(name for name in optional if name in names))


def _open(table: TableFile, **options: Any) -> Any:
    if FileStamp.of(table.path) != table.stamp:
        raise ValueError(f"{table.path}: the file was changed while it was in use; open the recording again")
    module = parquet()
    with _located(table.path):
        return module.ParquetFile(table.path, page_checksum_verification=True, **options)


@contextmanager
def _located(path: Path) -> Iterator[None]:
    """Whatever pyarrow finds wrong with a file, as one kind of error."""
    import pyarrow

    try:
        yield
    except (pyarrow.ArrowException, OSError, MemoryError, ValueError, TypeError, KeyError, IndexError, OverflowError) as error:
        message = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ValueError(f"{path}: not a whole Parquet file ({message}); copy it again") from error


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) < 60 else f"{text[:57]}..."
