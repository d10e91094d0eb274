"""Where the frames of a file are: found once, kept as a small JSON file, found again when the file changes.

The index lies beside the file it describes, or, where nothing can be written there, in ``$COIN3D_CACHE`` (by default
``~/.cache/coin3d``). It is a convenience: unreadable, outdated or damaged ones are made anew.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any, TypeVar

from coin3d.datasets.file_span import FileStamp
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
    places = _places(path)
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


def cache_folder() -> Path:
    """``$COIN3D_CACHE``, by default ``~/.cache/coin3d``."""
    named = os.environ.get("COIN3D_CACHE")
    return Path(named) if named else Path.home() / ".cache" / "coin3d"


def _places(path: Path) -> list[Path]:
    absolute = str(path.resolve())
    unique = hashlib.sha256(absolute.encode(errors="surrogateescape")).hexdigest()[:16]
    return [path.with_name(f"{path.name}.index.json"), cache_folder() / f"{path.name[:100]}.{unique}.index.json"]


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
