"""What every verb leaves behind: ``result.json`` and a list of its pictures on the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from coin3d.records import write_json

RESULT_FILE = "result.json"
_LISTED = 8


def finish(out: Path, result: Mapping[str, Any], pictures: Sequence[Path] = (), name: str = RESULT_FILE) -> None:
    """Write ``result.json``, atomically, and say where it and the pictures are.

    Args:
        out: folder for it.
        result: what it says.
        pictures: files that were drawn.
        name: of the file, for a verb that shares its folder with others of its kind.
    """
    write_json(out / name, {**result, "pictures": [str(p) for p in pictures]})
    for picture in pictures[:_LISTED]:
        print(f"picture: {picture}")
    if len(pictures) > _LISTED:
        print(f"... and {len(pictures) - _LISTED} more pictures in {pictures[-1].parent}")
    print(f"result:  {out / name}")


def spread(count: int, wanted: int) -> list[int]:
    """At most ``wanted`` places out of ``count``, evenly spread; 0 wants all.

    Raises:
        ValueError: a negative number.
    """
    if wanted < 0:
        raise ValueError(f"a number of frames or pictures is 0 (all) or more, got {wanted}")
    if wanted == 0 or wanted >= count:
        return list(range(count))
    if wanted == 1:
        return [count // 2]
    return sorted({round(i * (count - 1) / (wanted - 1)) for i in range(wanted)})
