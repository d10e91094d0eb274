"""Damage for parsers: bytes cut off and flipped, JSON with wrong types, huge numbers and names that lead elsewhere.

Whoever reads damaged files either raises one of the documented errors, naming the file, or gives something well-formed. A value
of another type never passes for a number or a name: then it is an error, or the value is not read and the result is the same.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from coin3d.datasets.frame import Frame, Recording

T = TypeVar("T")

WRONG: tuple[Any, ...] = (
    True, -1, 0, 3.5, 10**30, -(10**30), 1e300, float("nan"), float("inf"), "", "x", "7", "a\x00b", "../../../etc/passwd",
    "/etc/passwd", "C:\\x", [], {}, [[]], [0], {"a": 1}, "y" * 5000,
)  # fmt: skip


def read_through(recording: Recording) -> list[Frame]:
    """All frames, after their images and sweeps were loaded."""
    frames = list(recording)
    for frame in frames:
        if frame.lidar is not None:
            frame.lidar.load()
        for name in frame.rig:
            frame.image(name)
    return frames


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Cut off somewhere, or with up to four bits flipped, or with some bytes replaced by others or by extreme ones."""
    kind, found = rng.integers(4), bytearray(data)
    if kind == 0:
        return data[: rng.integers(len(data))]
    if kind == 1:
        for _ in range(rng.integers(1, 5)):
            found[rng.integers(len(found))] ^= 1 << int(rng.integers(8))
        return bytes(found)
    place, length = int(rng.integers(len(found))), int(rng.integers(1, 9))
    other = rng.bytes(length) if kind == 2 else bytes([int(rng.choice([0, 0x7F, 0xFF]))]) * length
    found[place : place + length] = other
    return bytes(found)


def broken_json(content: Any, rng: np.random.Generator) -> tuple[str, bool]:
    """A JSON text with one value exchanged, removed or doubled; and whether one was exchanged for another type."""
    content = copy.deepcopy(content)
    places = list(_places(content))
    holder, key = places[rng.integers(len(places))]
    old = holder[key]
    kind = rng.integers(8)
    if kind == 0:
        del holder[key]
        return json.dumps(content), False
    if kind == 1 and isinstance(holder, list):
        holder.insert(key, copy.deepcopy(old))
        return json.dumps(content), False
    holder[key] = WRONG[rng.integers(len(WRONG))]
    return json.dumps(content), _kind(old) is not _kind(holder[key])


def _kind(value: Any) -> type:
    return float if isinstance(value, int | float) and not isinstance(value, bool) else type(value)


def _places(value: Any) -> Any:
    if isinstance(value, dict | list):
        for key in value if isinstance(value, dict) else range(len(value)):
            yield value, key
            yield from _places(value[key])


def refused(
    read: Callable[[], T], *names: str, errors: tuple[type[Exception], ...] = (ValueError, FileNotFoundError)
) -> T | None:
    """What ``read`` gives, or None if it complained in words that hold one of the names (files, mostly)."""
    try:
        return read()
    except errors as error:
        assert type(error) in errors, f"{type(error).__name__} passed for {errors}: {error}"
        assert any(name in str(error) for name in names), f"the message names none of {names}: {error}"
        return None
