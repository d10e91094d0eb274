"""Typed values out of JSON that a person or a script wrote; every error says where the value stands."""

from __future__ import annotations

import difflib
import json
from collections.abc import Collection, Mapping
from typing import Any

from coin3d.geometry import Pose

_LARGEST = 1e12


def parse_object(text: bytes, where: str) -> dict[str, Any]:
    """One JSON object. NaN and infinity, which Python would accept, are refused, and so are repeated keys.

    Raises:
        ValueError: not that.
    """
    try:
        value = json.loads(text, parse_constant=_no_constant, object_pairs_hook=_unique)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{where}: not JSON: {error}") from error
    if not isinstance(value, dict):
        raise ValueError(f"{where}: an object in braces is expected, got {shown(value)}")
    return value


def known_keys(entry: Any, allowed: Collection[str], where: str, required: Collection[str] = ()) -> Mapping[str, Any]:
    """The entry, if it is an object with no other keys than these.

    Raises:
        ValueError: not an object, an unknown key, or a required one that is missing.
    """
    if not isinstance(entry, dict):
        raise ValueError(f"{where}: an object in braces is expected, got {shown(entry)}")
    if unknown := [key for key in entry if key not in allowed]:
        near = difflib.get_close_matches(unknown[0], list(allowed), 1, cutoff=0.75)
        hint = f"did you mean {near[0]}? " if near else ""
        raise ValueError(f"{where}: unknown key {shown(unknown[0])}; {hint}known are {', '.join(allowed)}")
    if missing := [key for key in required if key not in entry]:
        raise ValueError(f"{where}: '{missing[0]}' is missing")
    return entry


def one_of(entry: Mapping[str, Any], keys: Collection[str], where: str) -> str | None:
    """Which of several keys that say the same thing is there.

    Raises:
        ValueError: more than one.
    """
    given = [key for key in keys if key in entry]
    if len(given) > 1:
        raise ValueError(f"{where}: {' and '.join(given)} say the same thing; give one of them")
    return given[0] if given else None


def number(value: Any, where: str) -> float:
    """A finite number of sane size.

    Raises:
        ValueError: anything else.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _LARGEST:
        raise ValueError(f"{where}: a number is expected, got {shown(value)}")
    return float(value)


def numbers(value: Any, count: int, where: str) -> list[float]:
    """A list of so many finite numbers.

    Raises:
        ValueError: anything else.
    """
    if not isinstance(value, list) or len(value) != count:
        raise ValueError(f"{where}: a list of {count} numbers is expected, got {shown(value)}")
    return [number(item, where) for item in value]


def whole(value: Any, where: str, low: int, high: int = 2**63 - 1) -> int:
    """A whole number within limits.

    Raises:
        ValueError: anything else.
    """
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise ValueError(f"{where}: a whole number from {low} to {high} is expected, got {shown(value)}")
    return value


def text(value: Any, where: str) -> str:
    """A printable string of sane length.

    Raises:
        ValueError: anything else.
    """
    if not isinstance(value, str) or not 0 < len(value) <= 200 or not value.isprintable():
        raise ValueError(f"{where}: a text of 1 to 200 printable characters is expected, got {shown(value)}")
    return value


def pose(value: Any, where: str) -> Pose:
    """A pose: four rows of four numbers, or an object with ``translation_m`` and ``quaternion_wxyz``.

    Raises:
        ValueError: neither of them, or no rotation.
    """
    try:
        if isinstance(value, list):
            if len(value) != 4:
                raise ValueError(f"four rows of four numbers are expected, got {shown(value)}")
            return Pose.from_matrix([numbers(row, 4, f"row {i}") for i, row in enumerate(value)])
        entry = known_keys(value, ("translation_m", "quaternion_wxyz"), "pose", ("translation_m", "quaternion_wxyz"))
        translation = numbers(entry["translation_m"], 3, "translation_m")
        return Pose.from_quaternion(numbers(entry["quaternion_wxyz"], 4, "quaternion_wxyz"), translation)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error


def shown(value: Any) -> str:
    """A value as errors show it, cut where it gets long."""
    try:
        written = repr(value)
    except ValueError:  # Python refuses to write out whole numbers of thousands of digits
        return "a number of thousands of digits"
    except RecursionError:
        return "lists in lists in lists"
    return written if len(written) <= 60 else written[:57] + "..."


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is no number; leave out what is not known")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    entry = dict(pairs)
    if len(entry) < len(pairs):
        keys = [key for key, _ in pairs]
        raise ValueError(f"the key '{next(key for key in keys if keys.count(key) > 1)}' is there twice")
    return entry
