"""Write drives as a DGP recording (the format of DDAD), from its description."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from coin3d.geometry import Pose
from waymo_drive import Drive

CYCLE_YEARS = 400
"""Published times lie centuries ahead; the calendar repeats after this many years."""


def write_dgp(root: Path, drives: list[Drive]) -> Path:
    """Images as PNG, points as float64; drive by drive into the splits train, val, ..."""
    splits = {}
    for number, drive in enumerate(drives):
        _write_scene(root / drive.segment, drive)
        splits[str(number)] = {"filenames": [f"{drive.segment}/scene_{number:040x}.json"]}
        (root / drive.segment / "scene.json").rename(root / splits[str(number)]["filenames"][0])
    _json(root / "ddad.json", {"metadata": {"name": "town"}, "scene_splits": splits})
    return root


def _write_scene(folder: Path, drive: Drive) -> None:
    names = sorted({str(label) for frame in drive.frames for label in frame.boxes_world.labels})
    numbers = {name: i for i, name in enumerate(names)}
    _json(folder / "ontology" / "names.json", {"items": [{"id": i, "name": name} for name, i in numbers.items()]})
    roof = drive.lasers["TOP"].vehicle_from_laser
    intrinsics = [dict.fromkeys(("fx", "fy", "cx", "cy", "skew"), 0)]
    for camera in drive.mounts.values():
        K = camera.K
        # OpenCV counts from the middle of the first pixel
        intrinsics.append({"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2] - 0.5, "cy": K[1, 2] - 0.5, "skew": K[0, 1]})
    mounts = [_pose(roof), *(_pose(camera.ego_from_cam) for camera in drive.mounts.values())]
    _json(
        folder / "calibration" / "car.json",
        {"names": ["LIDAR", *drive.mounts], "intrinsics": intrinsics, "extrinsics": mounts},
    )
    data, samples = [], []
    for k, frame in enumerate(drive.frames):
        world_from_lidar = frame.world_from_ego @ roof
        scan = frame.lidar.load()
        cloud = {
            "filename": f"point_cloud/LIDAR/{frame.token}.npz",
            "point_format": ["X", "Y", "Z", "INTENSITY"],
            "pose": _pose(world_from_lidar),
            "annotations": {"1": f"bounding_box_3d/LIDAR/{frame.token}.json"},
        }
        rows = np.column_stack([roof.inverse().apply(scan.points_ego), scan.intensity])
        (folder / cloud["filename"]).parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(folder / cloud["filename"], data=rows)
        _json(folder / cloud["annotations"]["1"], {"annotations": _boxes(frame, world_from_lidar, numbers)})
        data.append(_datum(frame.token, "LIDAR", frame.timestamp_ns, {"point_cloud": cloud}))
        for name, image in frame.images.items():
            file = f"rgb/{name}/{frame.token}{drive.codec.suffix}"
            drive.codec.write(folder / file, image)
            pose = _pose(drive.image_poses[k][name] @ drive.mounts[name].ego_from_cam)
            content = {"filename": file, "height": image.shape[0], "width": image.shape[1], "pose": pose}
            data.append(_datum(f"{frame.token} {name}", name, frame.timestamp_ns - 20_000_000, {"image": content}))
        keys = [frame.token, *(f"{frame.token} {name}" for name in frame.images)]
        samples.append({"calibration_key": "car", "datum_keys": keys, "id": {"index": str(k)}})
    # the order of lists means nothing
    _json(folder / "scene.json", {"data": data[::-1], "samples": samples[::-1], "ontologies": {"1": "names"}})


def _boxes(frame: Any, world_from_lidar: Pose, numbers: dict[str, int]) -> list[dict[str, Any]]:
    boxes, rows = frame.boxes_world, []
    for i, (length, width, height) in enumerate(boxes.size_m.tolist()):
        upright = Pose.from_euler(float(boxes.yaw_rad[i]), 0.0, 0.0, boxes.centre_m[i])
        rows.append(
            {
                "class_id": numbers[str(boxes.labels[i])],
                "instance_id": str(boxes.instance_ids[i]),
                "num_points": int(boxes.num_lidar_points[i]),
                "box": {
                    "pose": _pose(world_from_lidar.inverse() @ upright), "length": length, "width": width, "height": height,
                },
            }
        )  # fmt: skip
    return rows


def _datum(key: str, name: str, time_ns: int, content: dict[str, Any]) -> dict[str, Any]:
    time = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=time_ns // 1000)
    moved = time.replace(year=time.year + CYCLE_YEARS).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    return {"key": key, "id": {"name": name, "timestamp": moved, "index": "0"}, "datum": content}


def _pose(pose: Pose) -> dict[str, Any]:
    rotation = dict(zip(("qw", "qx", "qy", "qz"), pose.quaternion.tolist(), strict=True))
    return {"rotation": rotation, "translation": dict(zip("xyz", pose.translation.tolist(), strict=True))}


def _json(path: Path, content: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))
