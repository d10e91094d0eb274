"""Rows of the nuScenes v1.0 tables for a town, and the tables on disk."""

from __future__ import annotations

import hashlib
import json
import shutil
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from coin3d.geometry import Boxes3D, Camera, Pose

VERSION = "v1.0-town"
TABLES = (
    "attribute",
    "calibrated_sensor",
    "category",
    "ego_pose",
    "instance",
    "log",
    "map",
    "sample",
    "sample_annotation",
    "sample_data",
    "scene",
    "sensor",
    "visibility",
)
CATEGORIES = (
    "vehicle.car",
    "vehicle.truck",
    "vehicle.bus.rigid",
    "vehicle.bicycle",
    "vehicle.motorcycle",
    "human.pedestrian.adult",
)
ATTRIBUTES = (
    "vehicle.moving",
    "vehicle.stopped",
    "vehicle.parked",
    "cycle.with_rider",
    "cycle.without_rider",
    "pedestrian.standing",
    "pedestrian.moving",
)
_VISIBILITY = (("1", "v0-40", 0, 40), ("2", "v40-60", 40, 60), ("3", "v60-80", 60, 80), ("4", "v80-100", 80, 100))

Row = dict[str, Any]
Rows = dict[str, list[Row]]


def token(*parts: object) -> str:
    """A nuScenes token: 32 hexadecimal digits that follow from the parts."""
    return hashlib.md5("/".join(map(str, parts)).encode(), usedforsecurity=False).hexdigest()


def shared_rows() -> Rows:
    """The tables that are the same in every recording."""
    rows: Rows = {name: [] for name in TABLES}
    rows["category"] = [{"token": token("category", n), "name": n, "description": ""} for n in CATEGORIES]
    rows["attribute"] = [{"token": token("attribute", n), "name": n, "description": ""} for n in ATTRIBUTES]
    rows["visibility"] = [
        {"description": f"visibility of whole object is between {low} and {high}%", "token": t, "level": level}
        for t, level, low, high in _VISIBILITY
    ]
    return rows


def visibility_token(share: float) -> str:
    """The level of a visible share in [0, 1]."""
    return str(1 + int(np.searchsorted([0.4, 0.6, 0.8], share, side="right")))


def pose_fields(pose: Pose) -> Row:
    """Translation and quaternion (w, x, y, z)."""
    return {"translation": pose.translation.tolist(), "rotation": pose.quaternion.tolist()}


def read_back(row: Row) -> Pose:
    """The pose exactly as a reader of the table gets it."""
    return Pose.from_quaternion(row["rotation"], row["translation"])


def intrinsic_field(camera: Camera) -> list[list[float]]:
    """K in the pixel origin of OpenCV (centre of the first pixel at 0), which nuScenes calibrations use."""
    K = camera.K.copy()
    K[:2, 2] -= 0.5
    return [[float(v) for v in row] for row in K]


def box_fields(boxes: Boxes3D, i: int) -> Row:
    """Centre, size as width, length, height, and the quaternion of the yaw."""
    length, width, height = boxes.size_m[i].tolist()
    half = boxes.yaw_rad[i] / 2
    return {
        "translation": boxes.centre_m[i].tolist(),
        "size": [width, length, height],
        "rotation": [float(np.cos(half)), 0.0, 0.0, float(np.sin(half))],
    }


def chain(rows: list[Row]) -> None:
    """Fill ``prev`` and ``next`` of rows in time order."""
    for before, after in pairwise(rows):
        before["next"], after["prev"] = after["token"], before["token"]


def write_json(path: Path, content: Any) -> None:
    """Write under a temporary name, then rename."""
    part = path.with_name(path.name + ".part")
    part.parent.mkdir(parents=True, exist_ok=True)
    part.write_text(json.dumps(content, indent=0))
    part.replace(path)


def write_tables(out: Path, scenes: list[Rows]) -> Path:
    """Merge the rows of all scenes into ``out/v1.0-town``; a table folder that is there already is replaced."""
    merged = shared_rows()
    for rows in scenes:
        for name in TABLES:
            known = {r["token"] for r in merged[name]}
            merged[name] += [r for r in rows.get(name, []) if r["token"] not in known]
    folder = out / VERSION
    part = out / f"{VERSION}.part"
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    for name in TABLES:
        (part / f"{name}.json").write_text(json.dumps(merged[name], indent=0))
    shutil.rmtree(folder, ignore_errors=True)
    part.rename(folder)
    return folder
