"""One JSON table of a nuScenes-format recording: a list of rows, each with a token."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

Row = dict[str, Any]


class Table:
    """Rows of one file by token. Whatever is missing is an error that names the file and the row.

    Args:
        path: the JSON file.

    Raises:
        FileNotFoundError: no such file.
        ValueError: not a list of rows with distinct tokens.
    """

    def __init__(self, path: Path) -> None:
        if not path.is_file():
            raise FileNotFoundError(f"{path}: this table of the recording is missing; copy the whole version folder")
        try:
            rows = json.loads(path.read_bytes())
            self._rows: dict[str, Row] = {row["token"]: row for row in rows}
        except (ValueError, TypeError, KeyError) as error:
            raise ValueError(f"{path}: not a JSON list of rows with a 'token' each ({error}); is the file complete?") from error
        if len(self._rows) != len(rows):
            raise ValueError(f"{path}: {len(rows) - len(self._rows)} rows repeat the token of another row")
        self.path = path

    def __len__(self) -> int:
        return len(self._rows)

    def rows(self) -> list[Row]:
        return list(self._rows.values())

    def find(self, token: str) -> Row | None:
        """The row of a token, if there is one."""
        return self._rows.get(token)

    def value(self, row: Row, field: str) -> Any:
        """A field of one of this table's rows.

        Raises:
            ValueError: the row lacks the field.
        """
        try:
            return row[field]
        except KeyError:
            raise ValueError(f"{self.path}: row '{row['token']}' has no field '{field}'") from None

    def follow(self, row: Row, field: str, target: Table) -> Row:
        """The row of ``target`` that ``row[field]`` of this table points to.

        Raises:
            ValueError: the field is missing or its token dangles.
        """
        token = self.value(row, field)
        found = target.find(token)
        if found is None:
            raise ValueError(
                f"{self.path}: {field} of row '{row['token']}' is '{token}', which is not in {target.path.name}: "
                "rows were removed, or the tables come from different recordings"
            )
        return found
