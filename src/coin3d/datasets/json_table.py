"""JSON tables of a nuScenes-format recording: each a list of rows, each row with a token of its own."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from io import TextIOWrapper
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np
from jaxtyping import Float, Int

from coin3d.datasets.json_stream import JsonStream
from coin3d.datasets.json_values import shown

Row = dict[str, Any]
Tell = Callable[[Path, int], None]
"""Told the table and how many of its bytes are read, now and then."""

_LONGEST_ROW = 1 << 20
_LONGEST_TOKEN = 1000
_MOST_MICROSECONDS = 9e15  # so that nanoseconds fit into 64 bits
_LARGEST = 1e12
_LARGEST = 1e12
_ROWS_BETWEEN_NEWS = 10_000


def rows_of(path: Path, tell: Tell | None = None) -> Iterator[Row]:
    """The rows of a table one by one, in memory for a portion of the file and eight bytes per row.

    Raises:
        FileNotFoundError: no such file.
        ValueError: not a list of rows with distinct tokens. Repeated tokens are found when all rows have been given.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: this table of the recording is missing; copy the whole version folder")
    hashes = array("q")
    try:
        with path.open("rb") as file, TextIOWrapper(file, encoding="utf-8-sig") as text:
            stream = JsonStream(text, path, _LONGEST_ROW)
            for i, row in enumerate(stream.items()):
                token = row.get("token") if isinstance(row, dict) else None
                if not isinstance(token, str) or not 0 < len(token) <= _LONGEST_TOKEN or not token.isprintable():
                    raise stream.error(f"row {i} has no 'token', or one that is no short text: {shown(row)}")
                hashes.append(hash(token))
                yield row
                if tell is not None and i % _ROWS_BETWEEN_NEWS == 0:
                    tell(path, file.tell())
            stream.finish()
    except ValueError as error:
        what = str(error).removeprefix(f"{path}: ")
        raise ValueError(f"{path}: not a JSON list of rows with a 'token' each ({what}); is the file complete?") from error
    _no_repeats(path, np.array(hashes, dtype=np.int64))


class Table:
    """The rows of a small table by token, with some of their fields. Whatever is missing is an error that names file and row.

    Args:
        path: the JSON file.
        fields: to keep beside the token.
        tell: told how far it is.

    Raises:
        FileNotFoundError: no such file.
        ValueError: not a list of rows with distinct tokens.
    """

    def __init__(self, path: Path, fields: Sequence[str], tell: Tell | None = None) -> None:
        self.path = path
        self._rows = {row["token"]: part(row, fields) for row in rows_of(path, tell)}

    def __len__(self) -> int:
        return len(self._rows)

    def rows(self) -> list[Row]:
        return list(self._rows.values())

    def find(self, token: str) -> Row | None:
        """The row of a token, if there is one."""
        return self._rows.get(token)


def part(row: Row, fields: Sequence[str]) -> Row:
    """The token and those of the fields that the row has."""
    return {"token": row["token"], **{name: row[name] for name in fields if name in row}}


def value(path: Path, row: Row, field: str) -> Any:
    """A field of a row of a table.

    Raises:
        ValueError: the row lacks the field.
    """
    try:
        return row[field]
    except KeyError:
        raise refused(path, row, f"has no field '{field}'") from None


def name(path: Path, row: Row, field: str) -> str:
    """A field that is a name of 1 to 200 printable characters."""
    found = value(path, row, field)
    if not isinstance(found, str) or not 0 < len(found) <= 200 or not found.isprintable():
        raise refused(path, row, f"has the {field} {shown(found)}, which should be a text of 1 to 200 printable characters")
    return found


def microseconds(path: Path, row: Row) -> int | float:
    """The timestamp of a row; Lyft writes decimals."""
    found = value(path, row, "timestamp")
    if isinstance(found, bool) or not isinstance(found, int | float) or not abs(found) <= _MOST_MICROSECONDS:
        raise refused(path, row, f"has the timestamp {shown(found)}, which should be a number of microseconds")
    return found


def flag(path: Path, row: Row, field: str) -> bool:
    """A field that is true or false."""
    found = row[field] if field in row else value(path, row, field)
    if not isinstance(found, int) or found not in (0, 1):
        raise refused(path, row, f"has the {field} {shown(found)}, which should be true or false")
    return bool(found)


def follow(path: Path, row: Row, field: str, target: Table) -> Row:
    """The row of ``target`` that a field of a row points to.

    Raises:
        ValueError: the field is missing or its token dangles.
    """
    token = value(path, row, field)
    found = target.find(token) if isinstance(token, str) else None
    if found is None:
        raise dangling(path, row["token"], field, token, target.path)
    return found


def dangling(path: Path, token: str, field: str, target_token: Any, target: Path) -> ValueError:
    """The error for a link that leads nowhere."""
    return ValueError(
        f"{path}: {field} of row '{token}' is {shown(target_token)}, which is not in {target.name}: "
        "rows were removed, or the tables come from different recordings"
    )


def refused(path: Path, row: Row, why: str) -> ValueError:
    """An error about one row."""
    return ValueError(f"{path}: row '{row['token']}' {why}")


def numbers(found: Any) -> Float[np.ndarray, "..."]:
    """Numbers in lists as an array of float64, of whatever shape they have; they may be infinite or NaN.

    Raises:
        ValueError: something else than numbers, lists of unequal lengths, or a finite number beyond 1e12.
    """
    try:
        parsed = np.array(found)
    except ValueError:
        parsed = np.array(None)
    if parsed.dtype.kind not in "iuf" or _has_bool(found):
        raise ValueError(f"numbers are expected, got {shown(found)}")
    converted = parsed.astype(np.float64)
    if (np.isfinite(converted) & (np.abs(converted) > _LARGEST)).any():
        raise ValueError(f"numbers of sane size are expected, got {shown(found)}")
    return converted


def is_sane_triple(found: Any) -> TypeGuard[list[int | float]]:
    """Whether a value is a list of three numbers of sane size."""
    return isinstance(found, list) and len(found) == 3 and all(type(n) in (int, float) and abs(n) <= _LARGEST for n in found)


def _has_bool(found: Any) -> bool:
    """Whether there is a true or false in lists, which Python takes for numbers."""
    return isinstance(found, bool) or (isinstance(found, list) and any(map(_has_bool, found)))


def _no_repeats(path: Path, hashes: Int[np.ndarray, "n"]) -> None:
    in_order = np.sort(hashes)
    again = in_order[1:][in_order[1:] == in_order[:-1]]
    if not len(again):
        return
    # different tokens may have equal hashes, so the file is asked
    suspects = set(again.tolist())
    with path.open(encoding="utf-8-sig") as file:
        rows = JsonStream(file, path, _LONGEST_ROW).items()
        counts = Counter(row["token"] for row in rows if hash(row["token"]) in suspects)
    repeats = {token: count - 1 for token, count in counts.items() if count > 1}
    if repeats:
        raise ValueError(f"{path}: {sum(repeats.values())} rows repeat the token of another row, first '{next(iter(repeats))}'")
