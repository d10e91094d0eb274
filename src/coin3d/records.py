"""Frozen dataclasses to plain data and back, and files that are never half-written."""

from __future__ import annotations

import dataclasses
import json
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

T = TypeVar("T")


def to_plain(value: Any) -> Any:
    """Dataclasses to dicts, tuples to lists; what JSON can hold is kept."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: to_plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(k): to_plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [to_plain(v) for v in value]
    if isinstance(value, Path):
        return str(value)
    return value


def from_plain(kind: type[T], data: Any, where: str = "") -> T:
    """Build a dataclass from the dict ``to_plain`` made; missing fields take their defaults.

    Raises:
        ValueError: an unknown field, or a value that is not of the field's kind.
    """
    where = where or kind.__name__
    if not isinstance(data, dict):
        raise ValueError(f"{where} must be a set of fields, got {data!r}")
    hints = get_type_hints(kind)
    names = {f.name for f in dataclasses.fields(kind)}  # type: ignore[arg-type]
    unknown = sorted(set(data) - names)
    if unknown:
        raise ValueError(f"{where} has no field {', '.join(unknown)}; it has {', '.join(sorted(names))}")
    return kind(**{k: _value(hints[k], v, f"{where}.{k}") for k, v in data.items()})


def _value(hint: Any, value: Any, where: str) -> Any:
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return from_plain(hint, value, where)
    origin, args = get_origin(hint), get_args(hint)
    if origin is tuple:
        if not isinstance(value, list):
            raise ValueError(f"{where} is a list, got {value!r}")
        kinds = [args[0]] * len(value) if args[-1] is Ellipsis else list(args)
        if len(kinds) != len(value):
            raise ValueError(f"{where} holds {len(kinds)} values, got {len(value)}")
        return tuple(_value(k, v, f"{where}[{i}]") for i, (k, v) in enumerate(zip(kinds, value, strict=True)))
    if origin in (typing.Union, types.UnionType):
        kinds = [a for a in args if a is not type(None)]
        return value if value is None or len(kinds) != 1 else _value(kinds[0], value, where)
    if origin is typing.Literal and value not in args:
        raise ValueError(f"{where} is one of {', '.join(map(repr, args))}, got {value!r}")
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    wrong_bool = isinstance(value, bool) and hint is not bool  # to Python a bool is an int
    if hint in (int, float, str, bool) and (wrong_bool or not isinstance(value, hint)):
        raise ValueError(f"{where} is of kind {hint.__name__}, got {value!r}")
    return value


def write_bytes(path: Path, content: bytes) -> None:
    """Write to a temporary name, then rename: a reader sees the old file or the whole new one."""
    partial = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            partial.write_bytes(content)
            partial.replace(path)
        except BaseException:
            partial.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OSError(f"{path}: cannot be written ({error.strerror or error}); nothing was changed") from error


def write_json(path: Path, data: Any) -> None:
    """Write plain data or a dataclass as JSON, atomically."""
    write_bytes(path, (json.dumps(to_plain(data), indent=1) + "\n").encode())
