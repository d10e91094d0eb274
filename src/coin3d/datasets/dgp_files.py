"""The files of a DGP recording, one by one: JSON with located errors, poses, calibrations, boxes, point clouds.

DGP is the format of DDAD (Toyota Research Institute). Every file is read from its documented fields; nothing else of it is
used.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from coin3d.datasets.frame import LidarScan
from coin3d.datasets.json_values import number, shown, whole
from coin3d.datasets.npz_file import read_npz_array
from coin3d.geometry import Boxes3D, Pose

# DGP calibrates with OpenCV, whose first pixel has its centre at 0
_OPENCV_PIXEL_SHIFT = 0.5
_INTRINSICS = ("fx", "fy", "cx", "cy", "skew")
_LARGEST_JSON = 2**29
_MOST_COLUMNS = 64
_LONGEST_INSTANCE = 50
_MOST_POINTS = 2**31 - 1
_LAST_YEAR = 2261
"""Nanoseconds since 1970 leave 64 bits in 2262."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """Where the sensors of a vehicle sit and what its cameras' K are.

    Args:
        path: the file, for messages.
        vehicle_from_sensor: sensor name -> mounting.
        K: sensor name -> (3, 3) intrinsics in this project's pixels; zero focal length for what is no camera.
    """

    path: Path
    vehicle_from_sensor: Mapping[str, Pose]
    K: Mapping[str, Float[np.ndarray, "3 3"]]


@dataclass(frozen=True, eq=False)
class PointCloudFile:
    """A point cloud on disk, read when asked for.

    Args:
        path: npz file with an array ``data`` of one row per point.
        columns: names of its columns, among them X, Y, Z.
        ego_from_lidar: from the frame of the points to the ego frame of the ``Frame`` that owns the cloud.
        origin_ego: (3,) where the rays started.
    """

    path: Path
    columns: Sequence[str]
    ego_from_lidar: Pose
    origin_ego: Float[np.ndarray, "3"]

    def load(self) -> LidarScan:
        """Read the cloud. Points that are not finite (no return) are left out.

        Raises:
            ValueError: the file is missing, truncated, or not of the announced columns.
        """
        rows = np.asarray(read_npz_array(self.path, "data"), dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != len(self.columns):
            raise ValueError(f"{self.path}: 'data' has shape {rows.shape}, the scene announces {', '.join(self.columns)}")
        named = {name.upper(): rows[:, i] for i, name in enumerate(self.columns)}
        if len(named) < len(self.columns):
            raise ValueError(f"{self.path}: the scene announces a column twice: {', '.join(self.columns)}")
        if missing := [axis for axis in "XYZ" if axis not in named]:
            raise ValueError(f"{self.path}: the scene announces no column {', '.join(missing)}")
        points = np.stack([named[axis] for axis in "XYZ"], axis=-1)
        finite = np.isfinite(points).all(1)
        intensity = named.get("INTENSITY", np.zeros(len(points)))
        return LidarScan(self.ego_from_lidar.apply(points[finite]), intensity[finite], np.asarray(self.origin_ego))


def read_json(path: Path) -> Any:
    """Content of a JSON file.

    Raises:
        ValueError: missing or not JSON.
    """
    if not path.is_file():
        raise ValueError(f"{path}: this file of the recording is missing; copy the whole scene folder")
    if path.stat().st_size > _LARGEST_JSON:
        raise ValueError(f"{path}: {path.stat().st_size} bytes are too many for a file of a scene (limit {_LARGEST_JSON})")
    try:
        return json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: not JSON ({error}); is the file complete?") from error


def field(entry: Any, name: str, where: str) -> Any:
    """``entry[name]``.

    Raises:
        ValueError: no such field.
    """
    if not isinstance(entry, Mapping) or name not in entry:
        raise ValueError(f"{where}: has no field '{name}'")
    return entry[name]


def rows_of(entry: Any, name: str, where: str) -> list[Any]:
    """``entry[name]``, which is a list.

    Raises:
        ValueError: no such field, or something else.
    """
    rows = field(entry, name, where)
    if not isinstance(rows, list):
        raise ValueError(f"{where}: '{name}' is a list, got {shown(rows)}")
    return rows


def name_of(entry: Any, name: str, where: str) -> str:
    """``entry[name]``, which is a text.

    Raises:
        ValueError: no such field, or something else.
    """
    text = field(entry, name, where)
    if not isinstance(text, str) or not text:
        raise ValueError(f"{where}: '{name}' is a text, got {shown(text)}")
    return text


def columns_of(entry: Any, where: str) -> list[str]:
    """The names of a point cloud's columns; raises ValueError naming ``where``."""
    columns = rows_of(entry, "point_format", where)
    if len(columns) > _MOST_COLUMNS or not all(isinstance(column, str) for column in columns):
        raise ValueError(f"{where}: 'point_format' lists the names of the columns, got {shown(columns)}")
    return columns


def read_pose(entry: Any, where: str) -> Pose:
    """``{rotation: {qw qx qy qz}, translation: {x y z}}`` as a pose; raises ValueError naming ``where``."""
    rotation, translation = field(entry, "rotation", where), field(entry, "translation", where)
    try:
        wxyz = [number(field(rotation, axis, where), f"{where}: {axis}") for axis in ("qw", "qx", "qy", "qz")]
        return Pose.from_quaternion(wxyz, [number(field(translation, axis, where), f"{where}: {axis}") for axis in "xyz"])
    except ValueError as error:
        message = str(error)
        raise ValueError(message if message.startswith(where) else f"{where}: {message}") from error


def read_time_ns(text: Any, where: str) -> int:
    """An ISO time as nanoseconds since 1970.

    Times of the published recordings are moved centuries ahead, beyond what 64 bits of nanoseconds hold; years from 2262 on
    are taken back by whole cycles of 400 years, after which the calendar repeats.
    """
    try:
        time = datetime.fromisoformat(text if isinstance(text, str) else "")
        time = (time if time.tzinfo else time.replace(tzinfo=UTC)).astimezone(UTC)
    except (ValueError, OverflowError) as error:
        raise ValueError(f"{where}: {shown(text)} is not a time such as 2020-01-31T12:00:00.000000Z") from error
    if time.year < 1970:
        raise ValueError(f"{where}: {shown(text)} is before 1970; is the time zone right?")
    while time.year > _LAST_YEAR:
        time = time.replace(year=time.year - 400)
    since = time - datetime(1970, 1, 1, tzinfo=UTC)
    return ((since.days * 86_400 + since.seconds) * 1_000_000 + since.microseconds) * 1000


def read_calibration(path: Path) -> Calibration:
    """The three parallel lists of a calibration file, by sensor name.

    Raises:
        ValueError: missing, lists of unequal length, a pose that is none, or lens distortion.
    """
    data = read_json(path)
    names, intrinsics, extrinsics = (rows_of(data, key, str(path)) for key in ("names", "intrinsics", "extrinsics"))
    if not len(names) == len(intrinsics) == len(extrinsics):
        raise ValueError(f"{path}: {len(names)} names, {len(intrinsics)} intrinsics, {len(extrinsics)} extrinsics")
    if not all(isinstance(name, str) for name in names) or len(set(names)) < len(names):
        raise ValueError(f"{path}: 'names' lists the sensors, each once, got {shown(names)}")
    mounts = {n: read_pose(e, f"{path}: extrinsics of {n}") for n, e in zip(names, extrinsics, strict=True)}
    return Calibration(path, mounts, {n: _K(e, f"{path}: intrinsics of {n}") for n, e in zip(names, intrinsics, strict=True)})


def read_boxes(path: Path, categories: Mapping[int, str]) -> Boxes3D:
    """Cuboids of one datum in the frame of its sensor, upright by their heading there.

    DGP's cuboid frame has its origin in the centre, x along the length, y along the width, z along the height.

    Args:
        path: annotation file.
        categories: class id -> name, from the ontology.

    Raises:
        ValueError: missing, damaged, or a class id that the ontology lacks.
    """
    poses, sizes, labels, instances, counts = [], [], [], [], []
    for i, row in enumerate(rows_of(read_json(path), "annotations", str(path))):
        where = f"{path}: annotation {i}"
        box = field(row, "box", where)
        poses.append(read_pose(field(box, "pose", where), where))
        sizes.append([number(field(box, side, where), f"{where}: {side}") for side in ("length", "width", "height")])
        if (class_id := whole(field(row, "class_id", where), f"{where}: class_id", -_MOST_POINTS)) not in categories:
            raise ValueError(f"{where}: class id {class_id} is not in the ontology ({len(categories)} classes)")
        labels.append(categories[class_id])
        instances.append(_instance(row.get("instance_id"), where))
        counts.append(whole(row.get("num_points", -1), f"{where}: num_points", -1, _MOST_POINTS))
    if not poses:
        return Boxes3D.empty()
    try:
        centres, yaws = np.stack([p.translation for p in poses]), [p.yaw_rad for p in poses]
        return Boxes3D.create(centres, sizes, yaws, labels, instance_ids=instances, num_lidar_points=counts)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: {error}") from error


def _instance(said: Any, where: str) -> str:
    """Files name instances by number or by text; an object without one is known in this frame alone."""
    if said is None:
        return ""
    if isinstance(said, bool) or not isinstance(said, int | str) or len(shown(said)) > _LONGEST_INSTANCE:
        raise ValueError(f"{where}: instance_id is a number or a text, got {shown(said)}")
    return str(said)


def _K(entry: Any, where: str) -> Float[np.ndarray, "3 3"]:
    if not isinstance(entry, Mapping):
        raise ValueError(f"{where}: fx, fy, cx, cy are expected, got {shown(entry)}")
    bent = [name for name, value in entry.items() if name not in _INTRINSICS and isinstance(value, (int, float)) and value]
    if bent:
        raise ValueError(f"{where}: lens distortion ({', '.join(bent)}) is not supported; rectify the images")
    fx, fy, cx, cy = (number(field(entry, name, where), f"{where}: {name}") for name in _INTRINSICS[:4])
    skew = number(entry.get("skew", 0.0), f"{where}: skew")
    return np.array([[fx, skew, cx + _OPENCV_PIXEL_SHIFT], [0, fy, cy + _OPENCV_PIXEL_SHIFT], [0, 0, 1]])
