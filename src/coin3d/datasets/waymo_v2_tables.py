"""The components of the Waymo Open Dataset, version 2: one Parquet file per component and segment (spec: table of tags)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, UInt8

from coin3d.datasets.image_source import decode_image
from coin3d.datasets.parquet_rows import FEW, MANY, Row, RowPlace, TableFile, read_rows, row_keys
from coin3d.datasets.waymo_parts import (
    CAMERA_NAMES,
    LABEL_NAMES,
    LASER_NAMES,
    CameraCalibration,
    WaymoImage,
    WaymoLabels,
    number_of,
    pose_of,
)
from coin3d.datasets.waymo_range_image import LaserCalibration, LaserImages
from coin3d.geometry import Boxes3D, Pose

SEGMENT = "key.segment_context_name"
TIMESTAMP = "key.frame_timestamp_micros"
_CAMERA, _LASER, _OBJECT = "key.camera_name", "key.laser_name", "key.laser_object_id"

_IMAGE = "[CameraImageComponent].image"
_IMAGE_POSE = "[CameraImageComponent].pose.transform"
_VEHICLE_POSE = "[VehiclePoseComponent].world_from_vehicle.transform"
_RETURNS = ("[LiDARComponent].range_image_return1", "[LiDARComponent].range_image_return2")
_PIXEL_POSES = "[LiDARPoseComponent].range_image_return1"
_CAMERA_CALIBRATION = "[CameraCalibrationComponent]"
_LASER_CALIBRATION = "[LiDARCalibrationComponent]"
_BOX = "[LiDARBoxComponent]"
_INTRINSIC = ("f_u", "f_v", "c_u", "c_v", "k1", "k2", "p1", "p2", "k3")


@dataclass(frozen=True)
class TableImage:
    """An image in a table, decoded when asked for.

    Args:
        table: file of camera images.
        place: row of the image.
        camera: name, for messages.
    """

    table: TableFile
    place: RowPlace
    camera: str

    def __str__(self) -> str:
        return f"{self.table.path}: image {self.camera} (row {self.place.row} of row group {self.place.group})"

    def load(self, reduction: int = 1) -> UInt8[np.ndarray, "h w 3"]:
        """The RGB image, ``reduction`` times smaller.

        Raises:
            FileNotFoundError: the file is gone.
            ValueError: the file was changed or is damaged, or the image is truncated or none.
        """
        (row,) = read_rows(self.table, [self.place], [_IMAGE], FEW)
        return decode_image(np.frombuffer(row.content(_IMAGE), dtype=np.uint8), str(self), reduction)


@dataclass(frozen=True, eq=False)
class TableLasers:
    """Range images in tables, read when asked for.

    Args:
        table: file of range images.
        places: laser name -> its row there.
        poses: file of pixel poses, if there is one.
        pose_places: laser name -> its row there.
    """

    table: TableFile
    places: Mapping[str, RowPlace]
    poses: TableFile | None
    pose_places: Mapping[str, RowPlace]

    def load(self, second_return: bool) -> Mapping[str, LaserImages]:
        """Read the range images.

        Raises:
            FileNotFoundError: a file is gone.
            ValueError: a file was changed, or is damaged.
        """
        wanted = _RETURNS if second_return else _RETURNS[:1]
        found = {}
        rows = read_rows(self.table, list(self.places.values()), _matrix_columns(*wanted), FEW)
        for name, row in zip(self.places, rows, strict=True):
            returns = tuple(matrix for matrix in (_matrix(row, column) for column in wanted) if matrix is not None)
            poses = None
            if self.poses is not None and name in self.pose_places:
                (pose_row,) = read_rows(self.poses, [self.pose_places[name]], _matrix_columns(_PIXEL_POSES), FEW)
                poses = _matrix(pose_row, _PIXEL_POSES)
            found[name] = LaserImages(returns, poses)
        return found


def frame_keys(table: TableFile) -> list[tuple[str, int]]:
    """Segment and timestamp of every frame of a file of vehicle poses; raises ValueError where it is damaged."""
    places = row_keys(table, TIMESTAMP).places()
    rows = read_rows(table, [place for _, place in places], [SEGMENT], MANY)
    return [(row.text(SEGMENT), time) for row, ((time,), _) in zip(rows, places, strict=True)]


def read_vehicle_pose(table: TableFile, timestamp_us: int) -> Pose:
    """World from vehicle of a frame; raises ValueError where it is missing or makes no sense."""
    places = [place for _, place in row_keys(table, TIMESTAMP).places(timestamp_us)]
    if len(places) != 1:
        raise ValueError(f"{table.path}: {len(places)} poses of the frame {timestamp_us}, one is expected")
    (row,) = read_rows(table, places, [_VEHICLE_POSE], MANY)
    return pose_of(row.numbers(_VEHICLE_POSE), row.where)


def read_images(table: TableFile, timestamp_us: int) -> dict[int, WaymoImage]:
    """Camera number -> image of a frame; raises ValueError where one makes no sense."""
    places = _by_second_key(table, timestamp_us, _CAMERA, CAMERA_NAMES)
    rows = read_rows(table, list(places.values()), [_IMAGE_POSE], MANY)
    return {
        number: WaymoImage(TableImage(table, place, CAMERA_NAMES[number]), pose_of(row.numbers(_IMAGE_POSE), row.where))
        for (number, place), row in zip(places.items(), rows, strict=True)
    }


def find_lasers(table: TableFile, poses: TableFile | None, timestamp_us: int) -> TableLasers | None:
    """Where the range images of a frame are, None if there are none; raises ValueError where the keys are damaged."""
    places = _by_second_key(table, timestamp_us, _LASER, LASER_NAMES)
    pose_places = {} if poses is None else _by_second_key(poses, timestamp_us, _LASER, LASER_NAMES)
    if not places:
        return None
    return TableLasers(
        table, {LASER_NAMES[n]: p for n, p in places.items()}, poses, {LASER_NAMES[n]: p for n, p in pose_places.items()}
    )


def read_labels(table: TableFile, timestamp_us: int) -> WaymoLabels:
    """The boxes of a frame; raises ValueError where one makes no sense."""
    places = [place for _, place in row_keys(table, TIMESTAMP).places(timestamp_us)]
    geometry = [f"{_BOX}.box.{name}" for name in ("center.x", "center.y", "center.z", "size.x", "size.y", "size.z", "heading")]
    kind, points = f"{_BOX}.type", f"{_BOX}.num_lidar_points_in_box"
    speeds = (f"{_BOX}.speed.x", f"{_BOX}.speed.y")
    rows = read_rows(table, places, [*geometry, kind], MANY, (_OBJECT, points, *speeds))
    boxes = np.array([[row.real(name) for name in geometry] for row in rows], dtype=np.float64).reshape(-1, 7)
    try:
        table_of_boxes = Boxes3D.create(
            boxes[:, :3],
            boxes[:, 3:6],
            boxes[:, 6],
            [LABEL_NAMES[number_of(row.whole(kind), LABEL_NAMES, row.where)] for row in rows],
            instance_ids=[row.text(_OBJECT) for row in rows],
            num_lidar_points=[row.whole(points, -1) for row in rows],
        )
    except ValueError as error:
        message = str(error)
        located = message.startswith(str(table.path))
        raise ValueError(message if located else f"{table.path}: frame {timestamp_us}: {message}") from error
    velocity = [[row.real(name, float("nan")) for name in speeds] for row in rows]
    return WaymoLabels(table_of_boxes, np.array(velocity, dtype=np.float64).reshape(-1, 2))


@lru_cache(maxsize=64)
def read_cameras(table: TableFile) -> Mapping[int, CameraCalibration]:
    """Camera number -> calibration of a segment; raises ValueError where one makes no sense."""
    names = [f"{_CAMERA_CALIBRATION}.intrinsic.{name}" for name in _INTRINSIC]
    extrinsic, width, height = (f"{_CAMERA_CALIBRATION}.{name}" for name in ("extrinsic.transform", "width", "height"))
    places = row_keys(table, _CAMERA).places()
    rows = read_rows(table, [place for _, place in places], [*names, extrinsic, width, height], MANY)
    found: dict[int, CameraCalibration] = {}
    for ((key,), _), row in zip(places, rows, strict=True):
        intrinsic = np.array([row.real(name) for name in names])
        if not np.isfinite(intrinsic).all():
            raise ValueError(f"{row.where}: intrinsics that are not finite: {intrinsic.tolist()}")
        mounting = pose_of(row.numbers(extrinsic), row.where)
        size = [row.whole(width), row.whole(height)]
        found[_once(key, CAMERA_NAMES, found, row)] = CameraCalibration(intrinsic, mounting, *size)
    return found


@lru_cache(maxsize=64)
def read_lasers(table: TableFile) -> Mapping[str, LaserCalibration]:
    """Laser name -> calibration of a segment; raises ValueError where one makes no sense."""
    extrinsic = f"{_LASER_CALIBRATION}.extrinsic.transform"
    lowest, highest, values = (f"{_LASER_CALIBRATION}.beam_inclination.{name}" for name in ("min", "max", "values"))
    places = row_keys(table, _LASER).places()
    rows = read_rows(table, [place for _, place in places], [extrinsic, lowest, highest], MANY, (values,))
    found: dict[int, LaserCalibration] = {}
    for ((key,), _), row in zip(places, rows, strict=True):
        inclinations = row.numbers(values)
        edges = [row.real(name, 0.0 if len(inclinations) else None) for name in (lowest, highest)]
        mounting = pose_of(row.numbers(extrinsic), row.where)
        try:
            found[_once(key, LASER_NAMES, found, row)] = LaserCalibration(mounting, edges[0], edges[1], inclinations)
        except ValueError as error:
            raise ValueError(f"{row.where}: {error}") from error
    return {LASER_NAMES[number]: calibration for number, calibration in found.items()}


def _once(key: int, names: Mapping[int, str], found: Mapping[int, object], row: Row) -> int:
    if number_of(key, names, row.where) in found:
        raise ValueError(f"{row.where}: a second calibration of {names[key]}")
    return key


def _by_second_key(table: TableFile, timestamp_us: int, key: str, names: Mapping[int, str]) -> dict[int, RowPlace]:
    found: dict[int, RowPlace] = {}
    for (time, number), place in row_keys(table, TIMESTAMP, key).places(timestamp_us):
        if number_of(number, names, f"{table.path}: frame {time}: {key}") in found:
            raise ValueError(f"{table.path}: frame {time}: two rows of {names[number]}")
        found[number] = place
    return dict(sorted(found.items()))


def _matrix_columns(*names: str) -> list[str]:
    return [f"{name}.{part}" for name in names for part in ("values", "shape")]


def _matrix(row: Row, name: str) -> Float[np.ndarray, "h w c"] | None:
    """A range image, None where there is none."""
    values, shape = row.numbers(f"{name}.values"), row.numbers(f"{name}.shape")
    if not len(values) and not len(shape):
        return None
    if len(shape) != 3 or not (np.isfinite(shape) & (shape >= 0)).all() or np.prod(shape) != len(values):
        raise ValueError(f"{row.where}: {len(values)} numbers in {name} for the shape {shape.tolist()[:4]}; it is damaged")
    return values.reshape(shape.astype(int))
