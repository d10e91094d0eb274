"""Write drives as nuScenes and as Lyft Level 5, from the descriptions of both and without the project's writer."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from coin3d.geometry import Pose
from waymo_drive import JPEG, Drive, Laser

BROKEN_LIDAR = "host-a011_lidar1_1233090652702363606.bin"
"""The one LiDAR file of Lyft whose number of floats is 3 more than a multiple of 5."""
JPEG_LEVELS = 4.0
"""By how much pixels of the town's pictures may differ after JPEG of quality 95, on average."""

Tables = dict[str, list[dict[str, Any]]]


@dataclass(frozen=True)
class Dialect:
    """How a data set writes the tables.

    Args:
        tables: folder of the tables.
        images: folder of an image, ``{}`` stands for the channel.
        lidar: folder of a sweep.
        is_lyft: decimal times, unknown counts, several attributes, a zoomed camera, a second LiDAR, a file cut short.
    """

    tables: str
    images: str
    lidar: str
    is_lyft: bool


NUSCENES = Dialect("v1.0-trainval", "samples/{}", "samples/LIDAR_TOP", False)
LYFT = Dialect("v1.01-train/v1.01-train", "images", "lidar", True)


def write_nuscenes(root: Path, drives: list[Drive]) -> Path:
    """Images as JPEG, sweeps as float32, numbers of tables in full."""
    return _write(root, drives, NUSCENES)


def write_lyft(root: Path, drives: list[Drive]) -> Path:
    """The same as Lyft has it."""
    return _write(root, drives, LYFT)


def _write(root: Path, drives: list[Drive], dialect: Dialect) -> Path:
    names = ("scene", "log", "sample", "sample_data", "ego_pose", "calibrated_sensor", "sensor", "sample_annotation",
             "instance", "category", "attribute", "visibility", "map")  # fmt: skip
    tables: Tables = {name: [] for name in names}
    channels = [*drives[0].mounts, *(["CAM_FRONT_ZOOMED"] if dialect.is_lyft else [])]
    tables["sensor"] += [{"token": c, "channel": c, "modality": "camera"} for c in channels]
    lidars = ["LIDAR_TOP", *(["LIDAR_FRONT_LEFT"] if dialect.is_lyft else [])]
    tables["sensor"] += [{"token": c, "channel": c, "modality": "lidar"} for c in lidars]
    categories = sorted({str(label) for d in drives for f in d.frames for label in f.boxes_world.labels})
    tables["category"] += [{"token": f"category {name}", "name": name, "description": ""} for name in categories]
    for drive in drives:
        _add_drive(root, tables, drive, dialect)
    for name, rows in tables.items():
        path = root / dialect.tables / f"{name}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(rows[::-1] if name in ("sample_data", "sensor", "ego_pose") else rows))
    return root


def _add_drive(root: Path, tables: Tables, drive: Drive, dialect: Dialect) -> None:
    tables["scene"].append({"token": f"scene {drive.segment}", "name": drive.segment, "nbr_samples": len(drive.frames)})
    for name, camera in drive.mounts.items():
        K = camera.K - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])  # OpenCV counts from the middle of the first pixel
        _calibrate(tables, drive, name, camera.ego_from_cam, K.tolist())
    roof: Laser = drive.lasers["TOP"]
    _calibrate(tables, drive, "LIDAR_TOP", roof.vehicle_from_laser, [])
    if dialect.is_lyft:
        _calibrate(tables, drive, "CAM_FRONT_ZOOMED", drive.mounts["FRONT"].ego_from_cam, np.diag([400.0, 400, 1]).tolist())
        _calibrate(tables, drive, "LIDAR_FRONT_LEFT", roof.vehicle_from_laser, [])
    annotated: dict[str, dict[str, Any]] = {}
    for k, frame in enumerate(drive.frames):
        time_us = frame.timestamp_ns // 1000
        sample = {"token": frame.token, "scene_token": f"scene {drive.segment}", "timestamp": _time(time_us, dialect)}
        tables["sample"].append({**sample, "prev": frame.previous, "next": frame.next})
        for name, image in frame.images.items():
            file = f"{dialect.images.format(name)}/{frame.token}_{name}.jpg"
            JPEG.write(root / file, image)
            then = drive.image_poses[k][name]
            _add_data(tables, drive, frame.token, name, file, then, time_us - 20_000, image.shape, dialect)
        scan = frame.lidar.load()
        is_first = k == 0 and not (root / dialect.lidar / BROKEN_LIDAR).is_file()
        file = f"{dialect.lidar}/{BROKEN_LIDAR if dialect.is_lyft and is_first else frame.token + '.bin'}"
        points = roof.vehicle_from_laser.inverse().apply(scan.points_ego)
        rows = np.column_stack([points, scan.intensity, np.zeros(len(points))]).astype("<f4")
        (root / file).parent.mkdir(parents=True, exist_ok=True)
        (root / file).write_bytes(rows.tobytes() + (b"\0" * 12 if file.endswith(BROKEN_LIDAR) else b""))
        _add_data(tables, drive, frame.token, "LIDAR_TOP", file, frame.world_from_ego, time_us, (0, 0), dialect)
        if dialect.is_lyft:
            front, still = drive.image_poses[k]["FRONT"], frame.world_from_ego
            _add_data(tables, drive, frame.token, "CAM_FRONT_ZOOMED", "images/none.jpg", front, time_us, (9, 9), dialect)
            _add_data(tables, drive, frame.token, "LIDAR_FRONT_LEFT", "lidar/none.bin", still, time_us, (0, 0), dialect)
        _annotate(tables, frame, annotated, dialect)


def _calibrate(tables: Tables, drive: Drive, channel: str, pose: Pose, intrinsic: list[list[float]]) -> None:
    row = {"token": f"{drive.segment} {channel}", "sensor_token": channel, "camera_intrinsic": intrinsic}
    tables["calibrated_sensor"].append({**row, **_pose(pose)})


def _add_data(
    tables: Tables,
    drive: Drive,
    sample: str,
    channel: str,
    file: str,
    world_from_ego: Pose,
    time_us: int,
    shape: tuple[int, ...],
    dialect: Dialect,
) -> None:
    token = f"{sample} {channel}"
    times = {"timestamp": _time(time_us, dialect)}
    tables["ego_pose"].append({"token": f"pose of {token}", **_pose(world_from_ego), **times})
    links = {"sample_token": sample, "ego_pose_token": f"pose of {token}"}
    links["calibrated_sensor_token"] = f"{drive.segment} {channel}"
    size = {"height": shape[0], "width": shape[1]}
    tables["sample_data"].append({"token": token, **links, "filename": file, **times, "is_key_frame": True, **size})


def _annotate(tables: Tables, frame: Any, annotated: dict[str, dict[str, Any]], dialect: Dialect) -> None:
    boxes = frame.boxes_world
    known = {row["token"] for row in tables["instance"]}
    for i, instance in enumerate(boxes.instance_ids.tolist()):
        if instance not in known:
            tables["instance"].append({"token": instance, "category_token": f"category {boxes.labels[i]}"})
        length, width, height = boxes.size_m[i].tolist()
        row = {
            "token": f"{frame.token} {instance}",
            "sample_token": frame.token,
            "instance_token": instance,
            "translation": boxes.centre_m[i].tolist(),
            "size": [width, length, height],
            "rotation": [float(np.cos(boxes.yaw_rad[i] / 2)), 0.0, 0.0, float(np.sin(boxes.yaw_rad[i] / 2))],
            "num_lidar_pts": -1 if dialect.is_lyft else int(boxes.num_lidar_points[i]),
            "num_radar_pts": 0,
            "attribute_tokens": ["parked", "standing"] if dialect.is_lyft else [],
            "visibility_token": "" if dialect.is_lyft else str(boxes.visibility[i] or ""),
            "prev": "",
            "next": "",
        }
        before = annotated.get(instance)
        if before is not None:
            row["prev"], before["next"] = before["token"], row["token"]
        annotated[instance] = row
        tables["sample_annotation"].append(row)


def _time(time_us: int, dialect: Dialect) -> float:
    return time_us + 0.25 if dialect.is_lyft else time_us


def _pose(pose: Pose) -> dict[str, Any]:
    return {"translation": pose.translation.tolist(), "rotation": pose.quaternion.tolist()}
