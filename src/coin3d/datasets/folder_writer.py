"""Any frames as a user's own recording: images, rig.yaml, frames.jsonl and LiDAR files that ``OwnRecording`` reads back."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from coin3d.datasets.folder import RIG_FILE
from coin3d.datasets.frame import Frame, LidarSource
from coin3d.datasets.frames_file import FRAMES_FILE
from coin3d.datasets.image_source import ImageSource, load_image
from coin3d.datasets.inside import plain_name
from coin3d.datasets.own_vehicle import FOLDER as OWN_VEHICLE
from coin3d.geometry import Boxes3D, Pose, Rig, save_rig
from coin3d.geometry.rig_file import rig_to_dict

_LIDAR_COLUMNS = ["x", "y", "z", "intensity"]


def write_folder_recording(frames: Iterable[Frame], root: Path | str) -> int:
    """Write frames as a folder that ``open_recording`` opens; returns how many there were.

    Image files are copied as they are, other images are written as PNG. LiDAR points are written as float32, relative to where
    the sensor was. The rig of the first frame becomes ``rig.yaml``; frames whose cameras are elsewhere (the vehicle drives on
    between camera and LiDAR) name rig files of their own. Scores of boxes and sweeps between frames are not kept.

    The folder appears when it is complete; what was written before an error is removed.

    Args:
        frames: one at a time, so that any recording will do.
        root: folder to make; it must not hold anything yet.

    Raises:
        FileExistsError: there is something in the folder.
        ValueError: no frames, a name that cannot become a file's, masks of the own vehicle that change, or a frame that cannot
            be read.
    """
    root = Path(root)
    if root.exists() and (not root.is_dir() or any(root.iterdir())):
        raise FileExistsError(f"{root}: exists and is not an empty folder; choose another")
    partial = root.with_name(f"{root.name}.part{os.getpid()}")
    partial.mkdir(parents=True)
    try:
        writer = _Writer(partial)
        with (partial / FRAMES_FILE).open("w", encoding="utf-8") as file:
            count = 0
            for frame in frames:
                file.write(json.dumps(writer.line(frame), allow_nan=False, ensure_ascii=False) + "\n")
                count += 1
        if not count:
            raise ValueError(f"{root}: there are no frames to write")
        if root.exists():
            root.rmdir()
        partial.replace(root)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    return count


@dataclass
class _Writer:
    """Writes the files of one frame after the other and tells the line of each.

    Args:
        root: folder to write into.
        rigs: content of a rig -> its file's name; "" for rig.yaml.
        masks: camera -> its mask of the own vehicle.
    """

    root: Path
    rigs: dict[str, str] = field(default_factory=dict)
    masks: dict[str, ImageSource] = field(default_factory=dict)

    def line(self, frame: Frame) -> dict[str, Any]:
        where = f"frame {frame.token}"
        token, scene = plain_name(frame.token, where), plain_name(frame.scene or "scene", where)
        entry: dict[str, Any] = {"token": token, "timestamp_ns": frame.timestamp_ns, "scene": scene}
        if rig := self._rig(frame.rig, token):
            entry["rig"] = rig
        entry["world_from_ego"] = _pose(frame.world_from_ego)
        folders = {camera: Path("images", plain_name(camera, where)) for camera in frame.images}
        entry["images"] = {c: self._image(source, folders[c] / token) for c, source in frame.images.items()}
        for camera, mask in frame.own_vehicle.items():
            self._mask(camera, mask, where)
        if frame.lidar is not None:
            entry["lidar"] = self._lidar(frame.lidar, frame.rig, token)
        if frame.boxes_world is not None:
            entry["boxes_world"] = _boxes(frame.boxes_world)
        return entry

    def _rig(self, rig: Rig, token: str) -> str:
        content = json.dumps(rig_to_dict(rig))
        if content not in self.rigs:
            self.rigs[content] = f"rigs/{token}.json" if self.rigs else ""
            if self.rigs[content]:
                self._write(self.rigs[content], content.encode())
            else:
                save_rig(rig, self.root / RIG_FILE)
        return self.rigs[content]

    def _image(self, source: ImageSource, stem: Path) -> str:
        if isinstance(source, Path):
            name = f"{stem.as_posix()}{source.suffix}"
            if not source.is_file():
                raise ValueError(f"{source}: the image file is missing")
            self._write(name, source.read_bytes())
            return name
        name = f"{stem.as_posix()}.png"
        self._write(name, _png(load_image(source)))
        return name

    def _mask(self, camera: str, mask: ImageSource, where: str) -> None:
        if camera not in self.masks:
            self.masks[camera] = mask
            self._write(f"{OWN_VEHICLE}/{camera}.png", _png(load_image(mask)))
        elif mask is not self.masks[camera] and not np.array_equal(load_image(mask), load_image(self.masks[camera])):
            raise ValueError(
                f"{where}: another mask of the own vehicle for '{camera}' than before; a folder holds one per camera"
            )

    def _lidar(self, source: LidarSource, rig: Rig, token: str) -> dict[str, Any]:
        scan = source.load()
        name = f"lidar/{token}.bin"
        points = np.concatenate([scan.points_ego - scan.origin_ego, scan.intensity[:, None]], axis=1)
        if not len(points):
            raise ValueError(f"frame {token}: its LiDAR sweep has no points, which a file cannot say; leave 'lidar' out of it")
        self._write(name, points.astype("<f4").tobytes())
        ego_from_lidar = Pose(np.eye(3), np.asarray(scan.origin_ego))
        vehicle_from_lidar = rig.ego_from_vehicle.inverse() @ ego_from_lidar
        return {"path": name, "columns": _LIDAR_COLUMNS, "vehicle_from_lidar": _pose(vehicle_from_lidar)}

    def _write(self, name: str, content: bytes) -> None:
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def _same(mask: ImageSource, other: ImageSource) -> bool:
    if mask is other or (isinstance(mask, Path) and mask == other):
        return True
    return np.array_equal(load_image(mask), load_image(other))


def _pose(pose: Pose) -> list[list[float]]:
    rows: list[list[float]] = pose.matrix.tolist()
    return rows


def _png(pixels: np.ndarray) -> bytes:
    if pixels.ndim == 3:
        pixels = cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR)
    elif pixels.dtype == bool:
        pixels = np.where(pixels, 255, 0).astype(np.uint8)
    return bytes(cv2.imencode(".png", pixels)[1])


def _boxes(boxes: Boxes3D) -> list[dict[str, Any]]:
    rows = []
    for i in range(len(boxes)):
        row: dict[str, Any] = {
            "category": str(boxes.labels[i]),
            "centre_m": boxes.centre_m[i].tolist(),
            **dict(zip(("length_m", "width_m", "height_m"), boxes.size_m[i].tolist(), strict=True)),
            "yaw_rad": float(boxes.yaw_rad[i]),
        }
        if boxes.num_lidar_points[i] >= 0:
            row["num_lidar_points"] = int(boxes.num_lidar_points[i])
        if boxes.instance_ids[i]:
            row["track"] = str(boxes.instance_ids[i])
        if np.isfinite(boxes.velocity_mps[i]).all():
            row["velocity_mps"] = boxes.velocity_mps[i].tolist()
        if boxes.visibility[i]:
            row["visibility"] = int(boxes.visibility[i])
        rows.append(row)
    return rows
