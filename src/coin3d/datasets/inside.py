"""Names of files in a recording lead to places inside the recording and nowhere else."""

from __future__ import annotations

from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from coin3d.datasets.json_values import shown

_LONGEST = 1000
_LONGEST_PART = 255


def inside(root: Path, name: Any, where: str) -> Path:
    """``root/name`` for the name of a file as a recording gives it.

    Links in the folder may lead anywhere, they are the user's own; the name itself must not climb out.

    Args:
        root: folder of the recording.
        name: what the recording says: a relative path with forward slashes.
        where: names the place in the recording for errors.

    Raises:
        ValueError: not a name, an absolute one, or one that leaves the folder.
    """
    if not isinstance(name, str) or not name or len(name) > _LONGEST or not name.isprintable() or _has_long_part(name):
        raise ValueError(f"{where}: the name of a file is expected, got {shown(name)}")
    path = PurePosixPath(name)
    if path.is_absolute() or PureWindowsPath(name).drive or "\\" in name or ".." in path.parts:
        raise ValueError(f"{where}: '{name}' leads out of the recording; give a path below {root}, with / between folders")
    return root / path


def _has_long_part(name: str) -> bool:
    """Whether no file system can have such a file."""
    return any(len(part.encode()) > _LONGEST_PART for part in name.split("/"))


def plain_name(name: Any, where: str) -> str:
    """A name that may become the name of a file: printable, without slashes, not too long.

    Raises:
        ValueError: another name.
    """
    if not isinstance(name, str) or not 0 < len(name) <= 200 or not name.isprintable() or {"/", "\\"} & set(name):
        raise ValueError(f"{where}: a name of 1 to 200 printable characters without slashes is expected, got {shown(name)}")
    if name in (".", ".."):
        raise ValueError(f"{where}: '{name}' is no name")
    return name
