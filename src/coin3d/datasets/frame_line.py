"""What one line of frames.jsonl says, turned into a ``Frame``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from coin3d.datasets.frames_file import BOXES, POSES
from coin3d.datasets.inside import inside
from coin3d.datasets.json_values import known_keys, number, numbers, one_of, pose, shown, text, whole
from coin3d.datasets.point_file import PointFile
from coin3d.geometry import VISIBILITY_PERCENT, Boxes3D, Pose, Rig

_IMAGE_KEYS = ("path", *POSES)
_LIDAR_KEYS = ("path", "columns", "vehicle_from_lidar")
_YAWS = ("yaw_rad", "yaw_deg", "quaternion_wxyz")
_SIZE = ("length_m", "width_m", "height_m")
_BOX_KEYS = ("category", "centre_m", *_SIZE, *_YAWS, "num_lidar_points", "track", "velocity_mps", "visibility")


def world_from_ego(entry: Mapping[str, Any], rig: Rig, where: str) -> Pose | None:
    """Where the vehicle was, by either of two keys; None if the entry does not say.

    Raises:
        ValueError: both keys, or no pose.
    """
    key = one_of(entry, POSES, where)
    if key is None:
        return None
    said = pose(entry[key], f"{where}: {key}")
    return said if key == "world_from_ego" else said @ rig.ego_from_vehicle.inverse()


def images_and_rig(
    entry: Mapping[str, Any], rig: Rig, world_from_ego_then: Pose | None, root: Path, where: str
) -> tuple[dict[str, Path], Rig]:
    """The image files of a frame, and the rig of the cameras that have one.

    An image that says where the vehicle was when it was taken moves its camera there, so that what stands still projects
    exactly.

    Raises:
        ValueError: a camera that the rig does not know, a name that leads out of the folder, a pose that makes no sense.
    """
    said = entry["images"]
    if not isinstance(said, dict) or not said:
        raise ValueError(f"{where}: 'images' names a file for each camera, got {shown(said)}")
    if unknown := [camera for camera in said if camera not in rig.cameras]:
        raise ValueError(f"{where}: the rig '{rig.name}' has no camera {shown(unknown[0])}, only {', '.join(rig)}")
    images, cameras = {}, {}
    for name in (name for name in rig if name in said):
        here = f"{where}: camera '{name}'"
        about = {"path": said[name]} if isinstance(said[name], str) else known_keys(said[name], _IMAGE_KEYS, here, ("path",))
        images[name] = inside(root, about["path"], here)
        cameras[name] = rig[name]
        taken = world_from_ego(about, rig, here)
        if taken is not None:
            if world_from_ego_then is None:
                raise ValueError(f"{here}: says where the vehicle was, but the frame does not; give {' or '.join(POSES)} too")
            cameras[name] = rig[name].moved(world_from_ego_then.inverse() @ taken @ rig[name].ego_from_cam)
    try:
        return images, rig.with_cameras(cameras)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error


def lidar_of(entry: Mapping[str, Any], rig: Rig, root: Path, where: str) -> PointFile | None:
    """The LiDAR file of a frame.

    Raises:
        ValueError: not a LiDAR file, or one whose columns are not told.
    """
    if "lidar" not in entry:
        return None
    here = f"{where}: lidar"
    about = known_keys(entry["lidar"], _LIDAR_KEYS, here, ("path", "vehicle_from_lidar"))
    columns = about.get("columns", [])
    if not isinstance(columns, list):
        raise ValueError(f"{here}: 'columns' is a list of names, got {shown(columns)}")
    ego_from_lidar = rig.ego_from_vehicle @ pose(about["vehicle_from_lidar"], f"{here}: vehicle_from_lidar")
    names = tuple(text(name, f"{here}: columns").lower() for name in columns)
    try:
        return PointFile(inside(root, about["path"], here), ego_from_lidar, names)
    except ValueError as error:
        raise ValueError(str(error) if str(error).startswith(where) else f"{here}: {error}") from error


def boxes_world(entry: Mapping[str, Any], rig: Rig, world_from_ego_then: Pose | None, where: str) -> Boxes3D | None:
    """The annotations of a frame in the world frame, whichever frame they are written in; None without annotations.

    Raises:
        ValueError: a box that makes no sense, or boxes in a world in which the vehicle has no place.
    """
    key = one_of(entry, BOXES, where)
    if key is None:
        return None
    if key == "boxes_world" and world_from_ego_then is None:
        raise ValueError(f"{where}: boxes_world need to know where the vehicle was; give {' or '.join(POSES)}")
    if not isinstance(entry[key], list):
        raise ValueError(f"{where}: {key} is a list of boxes, got {shown(entry[key])}")
    boxes = _table([_box(box, f"{where}: {key}[{i}]") for i, box in enumerate(entry[key])])
    if key == "boxes_world":
        return boxes
    ego = boxes.transformed(rig.ego_from_vehicle) if key == "boxes_vehicle" else boxes
    return ego if world_from_ego_then is None else ego.transformed(world_from_ego_then)


def _box(said: Any, where: str) -> dict[str, Any]:
    box = known_keys(said, _BOX_KEYS, where, ("category", "centre_m", *_SIZE))
    key = one_of(box, _YAWS, where)
    if key is None:
        raise ValueError(f"{where}: say where it points by one of {', '.join(_YAWS)}")
    size = [number(box[side], f"{where}: {side}") for side in _SIZE]
    if min(size) <= 0:
        raise ValueError(f"{where}: length, width and height are positive metres, got {size}")
    if key == "quaternion_wxyz":
        turn = {"translation_m": [0, 0, 0], "quaternion_wxyz": box[key]}
        yaw_rad = pose(turn, where).yaw_rad
    else:
        yaw_rad = number(box[key], f"{where}: {key}") * (np.pi / 180 if key == "yaw_deg" else 1.0)
    unknown = [np.nan, np.nan]
    return {
        "centre_m": numbers(box["centre_m"], 3, f"{where}: centre_m"),
        "size_m": size,
        "yaw_rad": yaw_rad,
        "labels": text(box["category"], f"{where}: category"),
        "velocity_mps": numbers(box["velocity_mps"], 2, f"{where}: velocity_mps") if "velocity_mps" in box else unknown,
        "instance_ids": text(box["track"], f"{where}: track") if "track" in box else "",
        "num_lidar_points": whole(box.get("num_lidar_points", -1), f"{where}: num_lidar_points", -1),
        "visibility": whole(box.get("visibility", 0), f"{where}: visibility", 0, len(VISIBILITY_PERCENT) - 1),
    }


def _table(rows: list[dict[str, Any]]) -> Boxes3D:
    if not rows:
        return Boxes3D.empty()
    return Boxes3D.create(**{name: [row[name] for row in rows] for name in rows[0]})
