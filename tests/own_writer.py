"""Write drives as a person would lay out an own recording, from docs/your_rig.md and without the project's writer."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from coin3d.geometry import Camera, Pose
from waymo_drive import Drive

COLUMNS = ("x", "y", "z", "intensity")


def write_own(root: Path, drives: list[Drive], rig_suffix: str = ".yaml") -> Path:
    """A rig file per drive, boxes in the world or on the vehicle, a sweep file of every kind in turn."""
    lines, number = [], 0
    for drive in drives:
        rig = f"{drive.segment}{rig_suffix}"
        _write_rig(root / rig, drive.mounts)
        for k, frame in enumerate(drive.frames):
            write = _LIDAR_KINDS[number % len(_LIDAR_KINDS)]
            number += 1
            images = {}
            for name, image in frame.images.items():
                file = f"{drive.segment}/{name}/{k}{drive.codec.suffix}"
                drive.codec.write(root / file, image)
                images[name] = {"path": file, "world_from_ego": drive.image_poses[k][name].matrix.tolist()}
            scan, roof = frame.lidar.load(), drive.lasers["TOP"].vehicle_from_laser
            rows = np.column_stack([roof.inverse().apply(scan.points_ego), scan.intensity])
            lidar = write(root, f"lidar/{frame.token}", rows)
            key, boxes = ("boxes_world", frame.boxes_world) if number % 2 else ("boxes_ego", frame.boxes)
            lines.append(
                {
                    "token": frame.token,
                    "scene": drive.segment,
                    "timestamp_us": frame.timestamp_ns // 1000,
                    "rig": rig,
                    "world_from_ego": _pose(frame.world_from_ego),
                    "images": images,
                    "lidar": {**lidar, "vehicle_from_lidar": _pose(roof)},
                    key: _boxes(boxes, frame.world_from_ego if key == "boxes_ego" else None),
                }
            )
    # within a scene time decides, not the line
    (root / "frames.jsonl").write_text("\n".join(json.dumps(line) for line in _scenes_kept(lines)) + "\n")
    return root


def write_images(root: Path, drive: Drive) -> Path:
    """Images of many frames beside a rig file, and nothing else."""
    _write_rig(root / "rig.yaml", drive.mounts)
    for frame in drive.frames:
        for name, image in frame.images.items():
            drive.codec.write(root / name / f"{frame.token}{drive.codec.suffix}", image)
    return root


def _scenes_kept(lines: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Scenes in their order, their frames backwards."""
    order = list(dict.fromkeys(line["scene"] for line in lines))
    return sorted(lines, key=lambda line: (order.index(line["scene"]), -line["timestamp_us"]))


def _write_rig(path: Path, mounts: dict[str, Camera]) -> None:
    cameras = {
        name: {
            "size": [camera.width_px, camera.height_px],
            "K": (camera.K - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])).tolist(),
            "vehicle_from_cam": camera.ego_from_cam.matrix.tolist(),
        }
        for name, camera in mounts.items()
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    content = {"name": path.stem, "pixel_origin": "opencv", "cameras": cameras}
    path.write_text(json.dumps(content) if path.suffix == ".json" else yaml.safe_dump(content, sort_keys=False))


def _pose(pose: Pose) -> dict[str, list[float]]:
    return {"translation_m": pose.translation.tolist(), "quaternion_wxyz": pose.quaternion.tolist()}


def _boxes(boxes: Any, world_from_ego: Pose | None) -> list[dict[str, Any]]:
    """Velocities are given in the frame of the boxes."""
    rows = []
    for i in range(len(boxes)):
        row = {
            "category": str(boxes.labels[i]),
            "centre_m": boxes.centre_m[i].tolist(),
            **dict(zip(("length_m", "width_m", "height_m"), boxes.size_m[i].tolist(), strict=True)),
            "yaw_deg": float(np.rad2deg(boxes.yaw_rad[i])),
            "num_lidar_points": int(boxes.num_lidar_points[i]),
            "track": str(boxes.instance_ids[i]),
        }
        if np.isfinite(boxes.velocity_mps[i]).all():
            row["velocity_mps"] = boxes.velocity_mps[i].tolist()
        if boxes.visibility[i]:
            row["visibility"] = int(boxes.visibility[i])
        rows.append(row)
    return rows


# --- sweeps ---


def _bin(root: Path, stem: str, rows: np.ndarray) -> dict[str, Any]:
    return _file(root, f"{stem}.bin", rows.astype("<f4").tobytes()) | {"columns": list(COLUMNS)}


def _npy(root: Path, stem: str, rows: np.ndarray) -> dict[str, Any]:
    (root / stem).parent.mkdir(parents=True, exist_ok=True)
    np.save(root / f"{stem}.npy", rows[:, [3, 0, 1, 2]])
    return {"path": f"{stem}.npy", "columns": [COLUMNS[i] for i in (3, 0, 1, 2)]}


def _pcd_ascii(root: Path, stem: str, rows: np.ndarray) -> dict[str, Any]:
    text = "\n".join(" ".join(map(repr, row)) for row in rows.tolist())
    return _file(root, f"{stem}.pcd", _header(len(rows), "ascii", 8) + text.encode() + b"\n")


def _pcd_binary(root: Path, stem: str, rows: np.ndarray) -> dict[str, Any]:
    return _file(root, f"{stem}.pcd", _header(len(rows), "binary", 4) + rows.astype("<f4").tobytes())


def _pcd_compressed(root: Path, stem: str, rows: np.ndarray) -> dict[str, Any]:
    """Field by field, the bytes as literals of at most 32."""
    fields = rows.astype("<f4").T.tobytes()
    packed = b"".join(bytes([len(fields[i : i + 32]) - 1]) + fields[i : i + 32] for i in range(0, len(fields), 32))
    body = struct.pack("<II", len(packed), len(fields)) + packed
    return _file(root, f"{stem}.pcd", _header(len(rows), "binary_compressed", 4) + body)


def _header(points: int, data: str, size: int) -> bytes:
    return (
        f"# .PCD v0.7\nVERSION 0.7\nFIELDS {' '.join(COLUMNS)}\nSIZE {' '.join([str(size)] * 4)}\nTYPE F F F F\nCOUNT 1 1 1 1\n"
        f"WIDTH {points}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA {data}\n"
    ).encode()


def _file(root: Path, name: str, content: bytes) -> dict[str, Any]:
    (root / name).parent.mkdir(parents=True, exist_ok=True)
    (root / name).write_bytes(content)
    return {"path": name}


_LIDAR_KINDS: tuple[Callable[[Path, str, np.ndarray], dict[str, Any]], ...] = (
    _bin, _npy, _pcd_ascii, _pcd_binary, _pcd_compressed,
)  # fmt: skip
