"""The files of a DGP recording, one by one: JSON with located errors, poses, calibrations, boxes, point clouds.

DGP is the format of DDAD (Toyota Research Institute). Every file is read from its documented fields; nothing else of it is
used.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from coin3d.datasets.frame import LidarScan
from coin3d.geometry import Boxes3D, Pose

# DGP calibrates with OpenCV, whose first pixel has its centre at 0
_OPENCV_PIXEL_SHIFT = 0.5
_INTRINSICS = ("fx", "fy", "cx", "cy", "skew")
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
        if not self.path.is_file():
            raise ValueError(f"{self.path}: the point cloud is missing")
        try:
            with np.load(self.path, allow_pickle=False) as archive:
                rows = np.asarray(archive["data"], dtype=np.float64)
        except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
            raise ValueError(f"{self.path}: not a complete npz file with an array 'data' ({error}); copy it again") from error
        if rows.ndim != 2 or rows.shape[1] != len(self.columns):
            raise ValueError(f"{self.path}: 'data' has shape {rows.shape}, the scene announces {', '.join(self.columns)}")
        named = {name.upper(): rows[:, i] for i, name in enumerate(self.columns)}
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
    try:
        return json.loads(path.read_bytes())
    except ValueError as error:
        raise ValueError(f"{path}: not JSON ({error}); is the file complete?") from error


def field(entry: Any, name: str, where: str) -> Any:
    """``entry[name]``.

    Raises:
        ValueError: no such field.
    """
    if not isinstance(entry, Mapping) or name not in entry:
        raise ValueError(f"{where}: has no field '{name}'")
    return entry[name]


def read_pose(entry: Any, where: str) -> Pose:
    """``{rotation: {qw qx qy qz}, translation: {x y z}}`` as a pose; raises ValueError naming ``where``."""
    rotation, translation = field(entry, "rotation", where), field(entry, "translation", where)
    try:
        wxyz = [float(field(rotation, axis, where)) for axis in ("qw", "qx", "qy", "qz")]
        return Pose.from_quaternion(wxyz, [float(field(translation, axis, where)) for axis in "xyz"])
    except (ValueError, TypeError) as error:
        message = str(error)
        raise ValueError(message if message.startswith(where) else f"{where}: {message}") from error


def read_time_ns(text: Any, where: str) -> int:
    """An ISO time as nanoseconds since 1970.

    Times of the published recordings are moved centuries ahead, beyond what 64 bits of nanoseconds hold; years from 2262 on
    are taken back by whole cycles of 400 years, after which the calendar repeats.
    """
    try:
        time = datetime.fromisoformat(str(text))
    except ValueError as error:
        raise ValueError(f"{where}: '{text}' is not a time such as 2020-01-31T12:00:00.000000Z") from error
    time = time if time.tzinfo else time.replace(tzinfo=UTC)
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
    names, intrinsics, extrinsics = (field(data, key, str(path)) for key in ("names", "intrinsics", "extrinsics"))
    if not len(names) == len(intrinsics) == len(extrinsics):
        raise ValueError(f"{path}: {len(names)} names, {len(intrinsics)} intrinsics, {len(extrinsics)} extrinsics")
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
    for number, row in enumerate(field(read_json(path), "annotations", str(path))):
        where = f"{path}: annotation {number}"
        box = field(row, "box", where)
        poses.append(read_pose(field(box, "pose", where), where))
        sizes.append([field(box, side, where) for side in ("length", "width", "height")])
        if (class_id := field(row, "class_id", where)) not in categories:
            raise ValueError(f"{where}: class id {class_id} is not in the ontology ({len(categories)} classes)")
        labels.append(categories[class_id])
        instances.append(str(row.get("instance_id", "")))
        counts.append(int(row.get("num_points", -1)))
    if not poses:
        return Boxes3D.empty()
    try:
        centres, yaws = np.stack([p.translation for p in poses]), [p.yaw_rad for p in poses]
        return Boxes3D.create(centres, sizes, yaws, labels, instance_ids=instances, num_lidar_points=counts)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: {error}") from error


def _K(entry: Any, where: str) -> Float[np.ndarray, "3 3"]:
    bent = [name for name, value in entry.items() if name not in _INTRINSICS and isinstance(value, (int, float)) and value]
    if bent:
        raise ValueError(f"{where}: lens distortion ({', '.join(bent)}) is not supported; rectify the images")
    fx, fy, cx, cy = (float(field(entry, name, where)) for name in _INTRINSICS[:4])
    skew = float(entry.get("skew", 0.0))
    return np.array([[fx, skew, cx + _OPENCV_PIXEL_SHIFT], [0, fy, cy + _OPENCV_PIXEL_SHIFT], [0, 0, 1]])
