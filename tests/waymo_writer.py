"""Write a drive in both formats of the Waymo Open Dataset, from their description and without the project's readers."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from coin3d.geometry import Camera, Pose
from waymo_drive import AXES, CAMERA_NUMBERS, LABEL_NUMBERS, LASER_NUMBERS, Drive, boxes_vehicle

COMPONENTS = (
    "camera_image", "camera_calibration", "vehicle_pose", "lidar", "lidar_calibration", "lidar_pose", "lidar_box",
)  # fmt: skip

# --- TFRecord and protocol buffers ---


def _crc_table() -> list[int]:
    table = []
    for byte in range(256):
        for _ in range(8):
            byte = byte >> 1 ^ (0x82F63B78 if byte & 1 else 0)
        table.append(byte)
    return table


_TABLE = _crc_table()


def masked_crc(data: bytes) -> int:
    """Byte by byte, as the checksum is defined."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc = _TABLE[(crc ^ byte) & 0xFF] ^ crc >> 8
    crc ^= 0xFFFFFFFF
    return ((crc >> 15 | crc << 17 & 0xFFFFFFFF) + 0xA282EAD8) % 2**32


def record(payload: bytes) -> bytes:
    length = struct.pack("<Q", len(payload))
    return length + struct.pack("<I", masked_crc(length)) + payload + struct.pack("<I", masked_crc(payload))


def varint(value: int) -> bytes:
    found = bytearray()
    while value >= 0x80:
        found.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*found, value])


def whole(number: int, value: int) -> bytes:
    return varint(number << 3) + varint(value)


def real(number: int, *values: float) -> bytes:
    return b"".join(varint(number << 3 | 1) + struct.pack("<d", value) for value in values)


def content(number: int, *parts: bytes) -> bytes:
    joined = b"".join(parts)
    return varint(number << 3 | 2) + varint(len(joined)) + joined


def packed(number: int, values: Sequence[float] | np.ndarray) -> bytes:
    return content(number, np.asarray(values, dtype="<f4").tobytes())


def matrix(values: np.ndarray) -> bytes:
    shape = content(2, *(whole(1, n) for n in values.shape))
    return zlib.compress(packed(1, values.ravel()) + shape)


def frame_payload(drive: Drive, k: int) -> bytes:
    """The message of one frame."""
    frame, boxes = drive.frames[k], boxes_vehicle(drive.frames[k])
    context = [content(1, drive.segment.encode())]
    for name, camera in drive.mounts.items():
        numbers = real(2, *_intrinsic(camera, drive.distortion)) + content(3, real(1, *_waymo_mount(camera)))
        size = whole(4, camera.width_px) + whole(5, camera.height_px) + whole(6, 1)
        context.append(content(2, whole(1, CAMERA_NUMBERS[name]), numbers, size))
    for name, laser in drive.lasers.items():
        edges = real(3, laser.low_rad) + real(4, laser.high_rad) + content(5, real(1, *laser.vehicle_from_laser.matrix.ravel()))
        context.append(content(3, whole(1, LASER_NUMBERS[name]), real(2, *laser.inclinations_rad), edges))
    parts = [
        content(1, *context),
        whole(2, frame.timestamp_ns // 1000),
        content(3, real(1, *frame.world_from_ego.matrix.ravel())),
    ]
    for name in reversed(drive.mounts):  # order in the file means nothing
        pose = content(3, real(1, *drive.image_poses[k][name].matrix.ravel()))
        image = content(2, drive.codec.encode(frame.images[name]))
        parts.append(content(4, whole(1, CAMERA_NUMBERS[name]), image, pose, real(5, 1.5)))
    for name in LASER_NUMBERS:
        sweep = drive.sweeps[k].get(name)
        if sweep is None:
            parts.append(content(5))
            continue
        poses = b"" if sweep.poses is None else content(4, matrix(sweep.poses))
        first, second = content(2, matrix(sweep.returns[0])) + poses, content(2, matrix(sweep.returns[1]))
        parts.append(content(5, whole(1, LASER_NUMBERS[name]), content(2, first), content(3, second)))
    for i in range(len(boxes)):
        (x, y, z), (length, width, height) = boxes.centre_m[i], boxes.size_m[i]
        box = b"".join(real(n, v) for n, v in enumerate((x, y, z, width, length, height, boxes.yaw_rad[i]), start=1))
        known = np.isfinite(frame.boxes_world.velocity_mps[i]).all()
        speed = b"".join(real(n, v) for n, v in enumerate(frame.boxes_world.velocity_mps[i], start=1) if known)
        kind = whole(3, LABEL_NUMBERS[str(boxes.labels[i])]) + content(4, str(boxes.instance_ids[i]).encode())
        parts.append(content(6, content(1, box), content(2, speed), kind, whole(7, int(boxes.num_lidar_points[i]))))
    return b"".join(parts) + content(8, whole(1, 1))


def write_v1(path: Path, drive: Drive) -> Path:
    """One TFRecord file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"".join(record(frame_payload(drive, k)) for k in range(len(drive.frames))))
    return path


# --- Parquet ---


def write_v2(root: Path, drive: Drive, row_group_size: int = 4, leave_out: Sequence[str] = ()) -> Path:
    """One file per component."""
    for tag in COMPONENTS:
        if tag not in leave_out and (drive.lasers or not tag.startswith("lidar") or tag == "lidar_box"):
            path = root / tag / f"{drive.segment}.parquet"
            path.parent.mkdir(parents=True, exist_ok=True)
            pq.write_table(component(drive, tag), path, row_group_size=row_group_size, compression="zstd")
    return root


def component(drive: Drive, tag: str) -> pa.Table:
    """The rows of a component."""
    rows, kinds = _ROWS[tag](drive)
    schema = pa.schema([("key.segment_context_name", pa.string()), *kinds.items()])
    return pa.Table.from_pylist([{"key.segment_context_name": drive.segment, **row} for row in rows], schema)


_F64, _F32, _I8, _I32, _I64, _TEXT = pa.float64(), pa.float32(), pa.int8(), pa.int32(), pa.int64(), pa.string()
_TIME, _CAMERA, _LASER = {"key.frame_timestamp_micros": _I64}, {"key.camera_name": _I8}, {"key.laser_name": _I8}
Rows = tuple[list[dict[str, Any]], dict[str, pa.DataType]]


def _time(drive: Drive, k: int) -> dict[str, int]:
    return {"key.frame_timestamp_micros": drive.frames[k].timestamp_ns // 1000}


def _camera_image(drive: Drive) -> Rows:
    prefix = "[CameraImageComponent]"
    rows = [
        {
            **_time(drive, k),
            "key.camera_name": CAMERA_NUMBERS[name],
            f"{prefix}.image": drive.codec.encode(frame.images[name]),
            f"{prefix}.pose.transform": _flat(drive.image_poses[k][name]),
            f"{prefix}.pose_timestamp": 1.5,
        }
        for k, frame in enumerate(drive.frames)
        for name in drive.mounts
    ]
    kinds = {f"{prefix}.image": pa.binary(), f"{prefix}.pose.transform": pa.list_(_F64), f"{prefix}.pose_timestamp": _F64}
    return rows, {**_TIME, **_CAMERA, **kinds}


def _camera_calibration(drive: Drive) -> Rows:
    prefix = "[CameraCalibrationComponent]"
    names = [f"{prefix}.intrinsic.{name}" for name in ("f_u", "f_v", "c_u", "c_v", "k1", "k2", "p1", "p2", "k3")]
    rows = [
        {
            "key.camera_name": CAMERA_NUMBERS[name],
            **dict(zip(names, _intrinsic(camera, drive.distortion), strict=True)),
            f"{prefix}.extrinsic.transform": _waymo_mount(camera),
            f"{prefix}.width": camera.width_px,
            f"{prefix}.height": camera.height_px,
        }
        for name, camera in drive.mounts.items()
    ]
    kinds = {**dict.fromkeys(names, _F64), f"{prefix}.extrinsic.transform": pa.list_(_F64)}
    return rows, {**_CAMERA, **kinds, f"{prefix}.width": _I32, f"{prefix}.height": _I32}


def _vehicle_pose(drive: Drive) -> Rows:
    name = "[VehiclePoseComponent].world_from_vehicle.transform"
    rows = [{**_time(drive, k), name: _flat(frame.world_from_ego)} for k, frame in enumerate(drive.frames)]
    return rows, {**_TIME, name: pa.list_(_F64)}


def _range_image(name: str, values: np.ndarray) -> dict[str, Any]:
    return {f"{name}.values": values.ravel().tolist(), f"{name}.shape": list(values.shape)}


def _matrix_kinds(*names: str) -> dict[str, pa.DataType]:
    return {f"{n}.{part}": pa.list_(kind) for n in names for part, kind in (("values", _F32), ("shape", _I32))}


def _lidar(drive: Drive) -> Rows:
    names = [f"[LiDARComponent].range_image_return{i}" for i in (1, 2)]
    rows = [
        {**_time(drive, k), "key.laser_name": LASER_NUMBERS[laser], **_range_image(names[0], sweep.returns[0])}
        | _range_image(names[1], sweep.returns[1])
        for k, sweeps in enumerate(drive.sweeps)
        for laser, sweep in sweeps.items()
    ]
    return rows, {**_TIME, **_LASER, **_matrix_kinds(*names)}


def _lidar_pose(drive: Drive) -> Rows:
    name = "[LiDARPoseComponent].range_image_return1"
    rows = [
        {**_time(drive, k), "key.laser_name": LASER_NUMBERS[laser], **_range_image(name, sweep.poses)}
        for k, sweeps in enumerate(drive.sweeps)
        for laser, sweep in sweeps.items()
        if sweep.poses is not None
    ]
    return rows, {**_TIME, **_LASER, **_matrix_kinds(name)}


def _lidar_calibration(drive: Drive) -> Rows:
    prefix = "[LiDARCalibrationComponent]"
    rows = [
        {
            "key.laser_name": LASER_NUMBERS[name],
            f"{prefix}.extrinsic.transform": _flat(laser.vehicle_from_laser),
            f"{prefix}.beam_inclination.min": laser.low_rad,
            f"{prefix}.beam_inclination.max": laser.high_rad,
            f"{prefix}.beam_inclination.values": laser.inclinations_rad or None,
        }
        for name, laser in drive.lasers.items()
    ]
    kinds = {f"{prefix}.extrinsic.transform": pa.list_(_F64), f"{prefix}.beam_inclination.min": _F64}
    more = {f"{prefix}.beam_inclination.max": _F64, f"{prefix}.beam_inclination.values": pa.list_(_F64)}
    return rows, {**_LASER, **kinds, **more}


def _lidar_box(drive: Drive) -> Rows:
    prefix = "[LiDARBoxComponent]"
    names = [f"{prefix}.box.{n}" for n in ("center.x", "center.y", "center.z", "size.x", "size.y", "size.z", "heading")]
    names += [f"{prefix}.speed.{axis}" for axis in "xyz"]
    rows = []
    for k, frame in enumerate(drive.frames):
        boxes = boxes_vehicle(frame)
        speed = np.column_stack([frame.boxes_world.velocity_mps, np.zeros(len(boxes))])
        numbers = np.column_stack([boxes.centre_m, boxes.size_m, boxes.yaw_rad, speed])
        for i in range(len(boxes)):
            points = int(boxes.num_lidar_points[i])
            kind = {f"{prefix}.type": LABEL_NUMBERS[str(boxes.labels[i])], f"{prefix}.num_lidar_points_in_box": points}
            key = {**_time(drive, k), "key.laser_object_id": str(boxes.instance_ids[i])}
            values = [None if np.isnan(number) else number for number in numbers[i].tolist()]
            rows.append({**key, **dict(zip(names, values, strict=True)), **kind})
    kinds = {"key.laser_object_id": _TEXT, **dict.fromkeys(names, _F64)}
    return rows, {**_TIME, **kinds, f"{prefix}.type": _I8, f"{prefix}.num_lidar_points_in_box": _I64}


_ROWS: dict[str, Callable[[Drive], Rows]] = {
    "camera_image": _camera_image,
    "camera_calibration": _camera_calibration,
    "vehicle_pose": _vehicle_pose,
    "lidar": _lidar,
    "lidar_calibration": _lidar_calibration,
    "lidar_pose": _lidar_pose,
    "lidar_box": _lidar_box,
}

# --- both ---


def _flat(pose: Pose) -> list[float]:
    return pose.matrix.ravel().tolist()


def _waymo_mount(camera: Camera) -> list[float]:
    return (camera.ego_from_cam.matrix @ AXES.T).ravel().tolist()


def _intrinsic(camera: Camera, distortion: Sequence[float]) -> list[float]:
    K = camera.K
    return [float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]), *distortion]
