"""A line now and then while large tables are read."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path

_SILENT_S = 3.0
_BETWEEN_S = 10.0


def to_stderr(line: str) -> None:
    """Where a reader says what takes long, so that the output of a command stays clean."""
    print(line, file=sys.stderr, flush=True)


class TableProgress:
    """How much of all tables is read. The first seconds pass in silence.

    Args:
        folder: with the tables, for the lines.
        sizes: bytes of each table.
        progress: called with a line.
    """

    def __init__(self, folder: Path, sizes: Mapping[Path, int], progress: Callable[[str], None]) -> None:
        self._folder, self._sizes, self._progress = folder, sizes, progress
        self._read: dict[Path, int] = {}
        self._begin = time.monotonic()
        self._next_s = _SILENT_S

    def __call__(self, path: Path, read_bytes: int) -> None:
        """Tell how many bytes of a table are read."""
        self._read[path] = read_bytes
        elapsed_s = time.monotonic() - self._begin
        if elapsed_s >= self._next_s:
            self._next_s = elapsed_s + _BETWEEN_S
            # those before are read whole
            done = sum(self._sizes[p] for p in self._read if p != path) + read_bytes
            self._progress(
                f"{self._folder}: making the index of its tables, which happens once: {path.name}, "
                f"{done / max(1, sum(self._sizes.values())):.0%} after {elapsed_s:.0f} s"
            )
