"""Where the index of a file lies: beside it, or, where nothing can be written there, in the cache folder."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

FRAMES_SUFFIX = ".index.json"
TABLES_SUFFIX = ".index.records"


def index_places(path: Path, suffix: str) -> list[Path]:
    """Where to look for the index of a file or to put it, best place first.

    Args:
        path: the file. In the cache folder, files of the same name are told apart by where they lie.
        suffix: ``FRAMES_SUFFIX`` or ``TABLES_SUFFIX``.
    """
    absolute = str(path.resolve())
    unique = hashlib.sha256(absolute.encode(errors="surrogateescape")).hexdigest()[:16]
    return [path.with_name(f"{path.name}{suffix}"), cache_folder() / f"{path.name[:100]}.{unique}{suffix}"]


def cache_folder() -> Path:
    """``$COIN3D_CACHE``, by default ``~/.cache/coin3d``."""
    named = os.environ.get("COIN3D_CACHE")
    return Path(named) if named else Path.home() / ".cache" / "coin3d"


def is_index(path: Path) -> bool:
    """Whether a file is an index by its name, and so no part of the data beside it."""
    return path.name.endswith((FRAMES_SUFFIX, TABLES_SUFFIX))
