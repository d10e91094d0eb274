"""The large tables of a nuScenes-format recording, joined in a temporary database on disk.

Rows are read one by one and what frames need of them goes into SQLite, which sorts and joins in bounded memory. The database
has no name: the operating system removes it, whatever happens. Small recordings never leave its cache.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from coin3d.datasets.json_table import (
    Row,
    Tell,
    dangling,
    flag,
    follow,
    is_sane_triple,
    microseconds,
    refused,
    rows_of,
    value,
)
from coin3d.datasets.json_values import shown
from coin3d.datasets.nuscenes_tables import Sample, SmallTables

_CACHE_KB = 1 << 16
_LONGEST_PART = 10_000
_MOST_BRACKETS = 40
_DATA_FIELDS = ("filename", "timestamp", "width", "height")
_POSE_FIELDS = ("translation", "rotation")
_ANNOTATION_FIELDS = ("instance_token", "translation", "size", "rotation", "num_lidar_pts", "visibility_token")
_SCHEMA = """
CREATE TABLE data (position INT, scene INT, channel TEXT, is_key INT, is_sweep INT, time_us, token TEXT, pose TEXT,
                   calibration INT, part TEXT);
CREATE TABLE pose (token TEXT PRIMARY KEY, part TEXT) WITHOUT ROWID;
CREATE TABLE annotation (position INT, token TEXT, time_s REAL, x REAL, y REAL, before TEXT, after TEXT, part TEXT);
"""
_encode = json.JSONEncoder(separators=(",", ":")).encode


class Staging:
    """What frames need of sample_data, ego_pose and sample_annotation, in the order of the frames.

    Args:
        folder: with the tables.
        small: the small tables.
        samples: in the order of the frames.
        tell: told how far it is.

    Raises:
        ValueError: a table cannot be parsed, a row makes no sense, or a link of a key frame dangles.
    """

    def __init__(self, folder: Path, small: SmallTables, samples: Sequence[Sample], tell: Tell | None = None) -> None:
        self._small, self._samples, self._tell = small, samples, tell
        self.data_path, self.pose_path, self.annotation_path = (
            folder / f"{table}.json" for table in ("sample_data", "ego_pose", "sample_annotation")
        )
        self._position: Mapping[str, int] = {sample.token: i for i, sample in enumerate(samples)}
        sensors = small.sensors()
        self._used = sensors.cameras | sensors.lidars
        self._sweep_channel = sensors.lidar_of(sensors.lidars)
        self._sensors: dict[str, tuple[int, str]] = {}
        self._calibrations = {row["token"]: i for i, row in enumerate(small.calibrated_sensor.rows())}
        self.some_filename = ""
        self.sweeps_problem = ""
        self._database = sqlite3.connect("")
        try:
            self._fill()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        self._database.close()

    @property
    def labelled(self) -> bool:
        """Whether there is any annotation."""
        return bool(next(self._select("SELECT EXISTS (SELECT * FROM annotation)"))[0])

    def key_data(self) -> Iterator[tuple[int, str, str, str, int, str, str | None]]:
        """Key-frame data of cameras and LiDARs, frame by frame.

        Position, channel, token, ego pose token, calibration, part of the sample_data row, and part of the ego_pose row or None
        where there is none.
        """
        return self._select(
            "SELECT position, channel, data.token, data.pose, calibration, data.part, pose.part FROM data"
            " LEFT JOIN pose ON pose.token = data.pose WHERE is_key ORDER BY position, data.rowid"
        )

    def sweeps(self) -> Iterator[tuple[int, int | float, int, str, str, int, str, str | None]]:
        """Data of the LiDAR, scene by scene by time: scene, time, whether of a key frame, then as in ``key_data``."""
        return self._select(
            "SELECT scene, time_us, is_key, data.token, data.pose, calibration, data.part, pose.part FROM data"
            " LEFT JOIN pose ON pose.token = data.pose WHERE is_sweep ORDER BY scene, time_us, data.rowid"
        )

    def annotations(self) -> Iterator[tuple[Any, ...]]:
        """Annotations frame by frame: position, part, then of itself, before and after: token, time in seconds, x, y.

        Where x is None, the translation makes no sense; where the time is None, there is no such neighbour.
        """
        return self._select(
            "SELECT a.position, a.part, a.token, a.time_s, a.x, a.y, a.before, p.time_s, p.x, p.y, a.after, n.time_s, n.x, n.y"
            " FROM annotation a LEFT JOIN annotation p ON p.token = a.before LEFT JOIN annotation n ON n.token = a.after"
            " ORDER BY a.position, a.rowid"
        )

    def _select(self, query: str) -> Iterator[Any]:
        return iter(self._database.execute(query))

    def _fill(self) -> None:
        database = self._database
        database.execute("PRAGMA journal_mode = OFF")
        database.execute("PRAGMA synchronous = OFF")
        database.execute(f"PRAGMA cache_size = -{_CACHE_KB}")
        database.executescript(_SCHEMA)
        database.executemany("INSERT INTO data VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", self._data_rows())
        database.execute("INSERT INTO pose SELECT DISTINCT pose, NULL FROM data ORDER BY pose")
        database.executemany("UPDATE pose SET part = ? WHERE token = ?", self._pose_rows())
        database.executemany("INSERT INTO annotation VALUES (?, ?, ?, ?, ?, ?, ?, ?)", self._annotation_rows())
        database.execute("CREATE INDEX annotation_by_token ON annotation (token)")

    def _data_rows(self) -> Iterator[tuple[Any, ...]]:
        path = self.data_path
        for i, row in enumerate(rows_of(path, self._tell)):
            if i == 0 and isinstance(row.get("filename"), str):
                self.some_filename = row["filename"]
            is_key = flag(path, row, "is_key_frame")
            try:
                number, channel = self._sensor(row)
                is_sweep = channel == self._sweep_channel
                if not is_key and not is_sweep:
                    continue
                position = self._position_of(path, row)
                pose = row["ego_pose_token"] if "ego_pose_token" in row else value(path, row, "ego_pose_token")
                if not isinstance(pose, str) or not pose.isprintable():
                    raise dangling(path, row["token"], "ego_pose_token", pose, self.pose_path)
                time_us = microseconds(path, row) if is_sweep else None
            except ValueError as error:
                if is_key:
                    raise
                self.sweeps_problem = self.sweeps_problem or str(error)  # frames can do without
                continue
            if channel in self._used:
                scene, text = self._samples[position].scene, encoded_part(path, row, _DATA_FIELDS)
                yield position, scene, channel, is_key, is_sweep, time_us, row["token"], pose, number, text

    def _sensor(self, row: Row) -> tuple[int, str]:
        """Number of the calibration and channel of a sample_data row."""
        token = row.get("calibrated_sensor_token")
        known = self._sensors.get(token) if isinstance(token, str) else None
        if known is None:
            calibration = follow(self.data_path, row, "calibrated_sensor_token", self._small.calibrated_sensor)
            known = self._calibrations[calibration["token"]], self._small.sensor_of(calibration)["channel"]
            self._sensors[calibration["token"]] = known
        return known

    def _position_of(self, path: Path, row: Row) -> int:
        """Position of the sample that a row belongs to."""
        token = row.get("sample_token")
        position = self._position.get(token) if isinstance(token, str) else None
        return self._position[follow(path, row, "sample_token", self._small.sample)["token"]] if position is None else position

    def _pose_rows(self) -> Iterator[tuple[str, str]]:
        for row in rows_of(self.pose_path, self._tell):
            yield encoded_part(self.pose_path, row, _POSE_FIELDS), row["token"]

    def _annotation_rows(self) -> Iterator[tuple[Any, ...]]:
        path, small = self.annotation_path, self._small
        for row in rows_of(path, self._tell):
            position = self._position_of(path, row)
            category = small.category_name(path, row)
            place = row.get("translation")
            x, y = (float(place[0]), float(place[1])) if is_sane_triple(place) else (None, None)
            text = encoded_part(path, {**row, "category": category}, (*_ANNOTATION_FIELDS, "category"))
            before, after = _neighbour(path, row, "prev"), _neighbour(path, row, "next")
            yield position, row["token"], float(self._samples[position].time_us) * 1e-6, x, y, before, after, text


def encoded_part(path: Path, row: Row, fields: Sequence[str]) -> str:
    """The token and some fields of a row as JSON, as they are.

    Raises:
        ValueError: fields that no sane row has: very long ones, or lists in lists in lists.
    """
    try:
        text = _encode({"token": row["token"], **{name: row[name] for name in fields if name in row}})
    except (ValueError, RecursionError):
        raise refused(path, row, f"has no sane {', '.join(fields)}") from None
    if len(text) > _LONGEST_PART or text.count("[") + text.count("{") > _MOST_BRACKETS:
        raise refused(path, row, f"has no sane {', '.join(fields)}: {len(text)} characters in lists of lists")
    return text


def _neighbour(path: Path, row: Row, field: str) -> str | None:
    token = row.get(field)
    if token is None or (isinstance(token, str) and token.isprintable()):
        return token or None
    raise refused(path, row, f"has the {field} {shown(token)}, which should be a token or ''")
