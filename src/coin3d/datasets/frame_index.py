"""Where the frames of a file are: found once, kept as a small JSON file, found again when the file changes.

Where it lies says ``index_place``. It is a convenience: unreadable, outdated or damaged ones are made anew.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any, TypeVar

from coin3d.datasets.file_span import FileStamp
from coin3d.datasets.index_place import FRAMES_SUFFIX, index_places
from coin3d.records import write_bytes

_FORMAT = "coin3d frame index 1"
_MAX_BYTES = 1 << 26

Entry = TypeVar("Entry", bound=Any)


def indexed(path: Path, kind: Callable[..., Entry], build: Callable[[], Sequence[Entry]]) -> list[Entry]:
    """The entries of a file, from its index where there is a good one.

    Args:
        path: the file.
        kind: a frozen dataclass of numbers and strings that checks what it is given.
        build: finds the entries in the file itself.

    Raises:
        FileNotFoundError: no such file.
        ValueError: from ``build``.
    """
    stamp = FileStamp.of(path)
    places = index_places(path, FRAMES_SUFFIX)
    for place in places:
        known = _read(place, stamp, kind)
        if known is not None:
            return known
    entries = list(build())
    content = {"format": _FORMAT, "size": stamp.size, "mtime_ns": stamp.mtime_ns, "entries": [astuple(e) for e in entries]}
    encoded = json.dumps(content, separators=(",", ":")).encode()
    for place in places:
        try:
            write_bytes(place, encoded)
            break
        except OSError:  # read-only or full: the next place, or this time without
            continue
    return entries


def _read(place: Path, stamp: FileStamp, kind: Callable[..., Entry]) -> list[Entry] | None:
    try:
        if not place.is_file() or place.stat().st_size > _MAX_BYTES:
            return None
        content = json.loads(place.read_bytes())
        if (content["format"], content["size"], content["mtime_ns"]) != (_FORMAT, stamp.size, stamp.mtime_ns):
            return None
        return [kind(*row) for row in content["entries"]]
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return None
