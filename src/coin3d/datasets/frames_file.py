"""frames.jsonl: one JSON object per frame of a user's own recording. This file finds the lines; ``frame_line`` reads them.

docs/your_rig.md describes the format.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from coin3d.datasets.inside import plain_name
from coin3d.datasets.json_values import known_keys, number, one_of, parse_object, whole

FRAMES_FILE = "frames.jsonl"

TIMES = {"timestamp_ns": 1, "timestamp_us": 1_000, "timestamp_ms": 1_000_000, "timestamp_s": 1_000_000_000}
"""Keys for the time of a frame -> nanoseconds per unit."""
POSES = ("world_from_ego", "world_from_vehicle")
BOXES = ("boxes_ego", "boxes_vehicle", "boxes_world")
FRAME_KEYS = ("token", *TIMES, "scene", "images", *POSES, *BOXES, "lidar", "rig")

_LONGEST_LINE = 64 * 2**20
_LATEST_NS = 2**63 - 1


@dataclass(frozen=True)
class Place:
    """Where a frame stands in the file, and what its order needs.

    Args:
        line: number of the line, from one.
        offset: of its first byte.
        token: name of the frame.
        scene: name of its scene.
        time_ns: reference time, 0 where unknown.
        has_pose: whether the line says where the vehicle was.
    """

    line: int
    offset: int
    token: str
    scene: str
    time_ns: int
    has_pose: bool


def read_places(path: Path, default_scene: str) -> list[Place]:
    """All frames: scenes in order of first appearance, by time within a scene.

    Every line is parsed once, so that a mistake in the last one shows when the recording is opened; what lines hold is not
    kept in memory.

    Raises:
        ValueError: a line that is no frame, a token twice, a time twice within a scene, or a scene of which only some frames
            say where the vehicle was.
    """
    scenes: dict[str, list[Place]] = {}
    lines: dict[str, int] = {}
    for line, offset, content in _lines(path):
        where = f"{path}, line {line}"
        entry = known_keys(parse_object(content, where), FRAME_KEYS, where, ("token", "images"))
        token = plain_name(entry["token"], f"{where}: token")
        if token in lines:
            raise ValueError(f"{where}: the token '{token}' stands in line {lines[token]} already; every frame needs its own")
        lines[token] = line
        scene = plain_name(entry.get("scene", default_scene), f"{where}: scene")
        has_pose = one_of(entry, POSES, where) is not None
        scenes.setdefault(scene, []).append(Place(line, offset, token, scene, _time_ns(entry, where), has_pose))
    if not scenes:
        raise ValueError(f"{path}: holds no frames; docs/your_rig.md shows the format")
    for places in scenes.values():
        places.sort(key=lambda place: place.time_ns)
        _agree(path, places)
    return [place for places in scenes.values() for place in places]


def read_place(path: Path, place: Place) -> Mapping[str, Any]:
    """The line of a frame.

    Raises:
        ValueError: the file has changed since it was opened.
    """
    with path.open("rb") as file:
        file.seek(place.offset)
        content = file.readline(_LONGEST_LINE)
    where = f"{path}, line {place.line}"
    try:
        entry = parse_object(content, where)
    except ValueError as error:
        raise ValueError(f"{where}: has changed since the recording was opened; open it again") from error
    if entry.get("token") != place.token:
        raise ValueError(f"{where}: has changed since the recording was opened; open it again")
    return entry


def _lines(path: Path) -> Iterator[tuple[int, int, bytes]]:
    """Number, offset and content of the lines that are not empty."""
    with path.open("rb") as file:
        # some editors begin a text file with a byte order mark
        offset = 3 if file.read(3) == b"\xef\xbb\xbf" else 0
        file.seek(offset)
        line = 0
        while content := file.readline(_LONGEST_LINE):
            line += 1
            if len(content) == _LONGEST_LINE:
                raise ValueError(f"{path}, line {line}: longer than {_LONGEST_LINE} bytes; every frame has a line of its own")
            if content.strip():
                yield line, offset, content
            offset += len(content)


def _time_ns(entry: Mapping[str, Any], where: str) -> int:
    key = one_of(entry, tuple(TIMES), where)
    if key is None:
        return 0
    if isinstance(entry[key], int):
        return whole(entry[key], f"{where}: {key}", 0, _LATEST_NS // TIMES[key]) * TIMES[key]
    time_ns = round(number(entry[key], f"{where}: {key}") * TIMES[key])
    if key == "timestamp_ns" or not 0 <= time_ns <= _LATEST_NS:
        raise ValueError(f"{where}: {key} is a time since 1970 or since the start of the recording, got {entry[key]!r}")
    return time_ns


def _agree(path: Path, places: list[Place]) -> None:
    for before, place in pairwise(places):
        where = f"{path}, line {max(before.line, place.line)}"
        if before.time_ns == place.time_ns != 0:
            raise ValueError(
                f"{where}: '{before.token}' and '{place.token}' of scene '{place.scene}' have the same time; is its unit right?"
            )
        if before.has_pose != place.has_pose:
            lacks = place if before.has_pose else before
            raise ValueError(
                f"{path}, line {lacks.line}: '{lacks.token}' does not say where the vehicle was ({' or '.join(POSES)}), other "
                f"frames of scene '{place.scene}' do"
            )
