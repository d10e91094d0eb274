"""Write a small recording in nuScenes format whose every number is known.

Scenes of three key frames 0.5 s apart. The ego drives 1 m per key frame along a heading of 0.3 rad; every camera fires
0.02 s before the LiDAR, when the ego is 0.04 m behind. One car, 4 x 2 x 1.5 m, drives 2 m/s along world x with seven LiDAR
points in it; one pedestrian stands in the first frame only, without points. The ground is world z = 0. Two LiDAR sweeps lie
between key frames. The first point of every sweep is the top of a pole that stands still.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from coin3d.geometry import Pose, camera_pose

SIZE = (96, 64)
K = [[60.0, 0.0, 47.5], [0.0, 60.0, 31.5], [0.0, 0.0, 1.0]]
HEADING = 0.3
POLE_WORLD = np.array([12.0, 9.0, 3.0])
EGO_FROM_LIDAR = Pose.from_euler(-np.pi / 2, 0.0, 0.0, [0.9, 0.0, 1.8])
CAMERAS = {
    "CAM_BACK": camera_pose([0.0, 0.0, 1.5], np.pi),
    "CAM_FRONT": camera_pose([1.7, 0.0, 1.5], 0.0),
    "A_SIDE_EYE": camera_pose([1.0, 0.5, 1.6], np.pi / 2, 0.2),
}
START_US = 1_600_000_000_000_000


def world_from_ego(metres: float) -> Pose:
    return Pose.from_euler(HEADING, 0.0, 0.0, [metres * np.cos(HEADING), metres * np.sin(HEADING), 0.0])


def write_recording(root: Path, scenes: int = 2, samples: int = 3, files: bool = True) -> Path:
    """Write the recording; without ``files`` only its tables."""
    tables: dict[str, list[dict[str, Any]]] = {name: [] for name in ("sample", "sample_data", "ego_pose", "sample_annotation")}
    tables["scene"] = [{"token": f"scene{s}", "name": f"street-{s}"} for s in range(scenes)]
    tables["sensor"] = [{"token": c, "channel": c, "modality": "camera"} for c in CAMERAS]
    tables["sensor"].append({"token": "LIDAR_TOP", "channel": "LIDAR_TOP", "modality": "lidar"})
    tables["calibrated_sensor"] = [_calibration(c, pose, K) for c, pose in CAMERAS.items()]
    tables["calibrated_sensor"].append(_calibration("LIDAR_TOP", EGO_FROM_LIDAR, []))
    tables["category"] = [{"token": n, "name": n} for n in ("vehicle.car", "human.pedestrian.adult")]
    tables["instance"] = [
        {"token": f"{kind}{s}", "category_token": category}
        for s in range(scenes)
        for kind, category in (("car", "vehicle.car"), ("walker", "human.pedestrian.adult"))
    ]
    for s in range(scenes):
        for k in range(samples):
            _write_sample(root, tables, s, k, samples, files)
    folder = root / "v1.0-tiny"
    folder.mkdir(parents=True)
    for name, rows in tables.items():
        (folder / f"{name}.json").write_text(json.dumps(rows))
    return root


def edit_table(root: Path, name: str, change: Callable[[list[dict[str, Any]]], object]) -> None:
    """Change the rows of a table on disk."""
    path = root / "v1.0-tiny" / f"{name}.json"
    rows = json.loads(path.read_text())
    change(rows)
    path.write_text(json.dumps(rows))


def car_world(k: int) -> np.ndarray:
    return np.array([8.0 + k * 1.0, 3.0, 0.75])


def _calibration(name: str, pose: Pose, intrinsic: list[list[float]]) -> dict[str, Any]:
    return {
        "token": f"calibrated_{name}",
        "sensor_token": name,
        "translation": pose.translation.tolist(),
        "rotation": pose.quaternion.tolist(),
        "camera_intrinsic": intrinsic,
    }


def _write_sample(root: Path, tables: dict[str, list[dict[str, Any]]], s: int, k: int, samples: int, files: bool) -> None:
    token, time_us = f"sample{s}.{k}", START_US + s * 60_000_000 + k * 500_000
    tables["sample"].append({"token": token, "timestamp": time_us, "scene_token": f"scene{s}"})
    for camera in CAMERAS:
        name = f"samples/{camera}/{s}_{k}.jpg"
        _add_data(tables, token, camera, name, time_us - 20_000, k - 0.04, True, SIZE)
        if files:
            _write_image(root / name)
    for part in range(3):
        name = f"{'sweeps' if part else 'samples'}/LIDAR_TOP/{s}_{k}_{part}.bin"
        _add_data(tables, token, "LIDAR_TOP", name, time_us + part * 166_000, k + part / 3, part == 0, (0, 0))
        if files:
            _write_lidar(root / name, k + part / 3, k)
    _annotate(tables, token, s, k, samples)


def _add_data(
    tables: dict[str, list[dict[str, Any]]],
    sample: str,
    channel: str,
    filename: str,
    time_us: int,
    metres: float,
    key: bool,
    size: tuple[int, int],
) -> None:
    pose = world_from_ego(metres)
    tables["ego_pose"].append(
        {
            "token": filename,
            "translation": pose.translation.tolist(),
            "rotation": pose.quaternion.tolist(),
            "timestamp": time_us,
        }
    )
    tables["sample_data"].append(
        {
            "token": filename,
            "sample_token": sample,
            "ego_pose_token": filename,
            "calibrated_sensor_token": f"calibrated_{channel}",
            "filename": filename,
            "timestamp": time_us,
            "is_key_frame": key,
            "width": size[0],
            "height": size[1],
        }
    )


def _annotate(tables: dict[str, list[dict[str, Any]]], sample: str, s: int, k: int, samples: int) -> None:
    common = {"sample_token": sample, "rotation": [1.0, 0.0, 0.0, 0.0]}
    tables["sample_annotation"].append(
        {
            **common,
            "token": f"ann_car{s}.{k}",
            "instance_token": f"car{s}",
            "translation": car_world(k).tolist(),
            "size": [2.0, 4.0, 1.5],
            "num_lidar_pts": 7,
            "visibility_token": "3",
            "prev": f"ann_car{s}.{k - 1}" if k else "",
            "next": f"ann_car{s}.{k + 1}" if k < samples - 1 else "",
        }
    )
    if k == 0:
        tables["sample_annotation"].append(
            {
                **common,
                "token": f"ann_walker{s}",
                "instance_token": f"walker{s}",
                "translation": [9.0, -4.0, 1.0],
                "size": [0.6, 0.7, 1.8],
                "num_lidar_pts": 0,
                "prev": "",
                "next": "",
            }
        )


def _write_image(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    image = np.full((SIZE[1], SIZE[0], 3), 90, dtype=np.uint8)
    image[:, : SIZE[0] // 2] = 150
    cv2.imwrite(str(path), image)


def _write_lidar(path: Path, metres: float, k: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    angle, radius = np.meshgrid(np.linspace(0, 2 * np.pi, 90, endpoint=False), np.linspace(4.0, 25.0, 25))
    ego = np.stack([radius * np.cos(angle) + 0.9, radius * np.sin(angle), 0 * radius], axis=-1).reshape(-1, 3)
    ground = world_from_ego(metres).apply(ego)
    in_car = car_world(k) + np.stack([np.linspace(-1.5, 1.5, 7), np.full(7, 0.4), np.linspace(-0.5, 0.5, 7)], axis=-1)
    # ground returns inside the car's outline would be hidden by it
    outside = (np.abs(ground[:, :2] - car_world(k)[:2]) > (2.1, 1.1)).any(1)
    world = np.concatenate([POLE_WORLD[None], in_car, ground[outside]])
    lidar = (world_from_ego(metres) @ EGO_FROM_LIDAR).inverse().apply(world)
    np.concatenate([lidar, np.full((len(lidar), 2), 0.5)], axis=1).astype("<f4").tofile(path)
