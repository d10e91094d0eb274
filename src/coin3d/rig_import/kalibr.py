"""Kalibr's camera chain: one YAML entry per camera, each with its pose relative to the camera before."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path
from reprlib import repr as short
from typing import Any

from coin3d.geometry import Camera, Lens, Pinhole, Pose
from coin3d.rig_import.base import Imported
from coin3d.rig_import.fields import entry, image_size, intrinsics, numbers, opencv_lens, pose_matrix, read_documents

IMU = "imu"
_OPENCV_PIXEL_SHIFT = 0.5


def is_kalibr(path: Path) -> bool:
    """Whether a file looks like a camera chain."""
    if not path.is_file() or path.suffix.lower() not in (".yaml", ".yml"):
        return False
    documents = read_documents(path)
    return len(documents) == 1 and isinstance(documents[0], dict) and any(_is_camera(key) for key in documents[0])


def read_kalibr(path: Path, base: str | None) -> Imported:
    """The cameras of a chain in the frame of ``base``: a camera of it (default: the first), or ``imu``.

    ``T_cn_cnm1`` maps coordinates of the camera before to this camera's; ``T_cam_imu`` those of the IMU.

    Raises:
        ValueError: naming the camera: a model other than pinhole with radtan, equidistant or no distortion, a missing or
            broken field, a gap in the numbering, or a base that is not there.
    """
    documents = read_documents(path)
    if len(documents) != 1 or not isinstance(documents[0], dict):
        raise ValueError(f"{path}: a camera chain is one YAML document with entries cam0, cam1, ...")
    chain = documents[0]
    names = sorted((str(key) for key in chain if _is_camera(key)), key=lambda name: int(name[3:]))
    if not names or names != [f"cam{i}" for i in range(len(names))]:
        raise ValueError(
            f"{path}: a camera chain has the entries cam0, cam1, ... without a gap, got {', '.join(names) or 'none'}"
        )
    base = names[0] if base is None else base
    if base not in (*names, IMU):
        raise ValueError(f"{path}: no frame '{base}'; --base is one of {', '.join(names)}, or {IMU}")
    first_from_cam = _chained(chain, names, path)
    if base == IMU:
        base_from_cam = {name: _cam_from_imu(chain, names, name, first_from_cam, path).inverse() for name in names}
    else:
        base_from_first = first_from_cam[base].inverse()
        base_from_cam = {name: base_from_first @ first_from_cam[name] for name in names}
    cameras = {name: _camera(chain[name], base_from_cam[name], f"{path}: {name}") for name in names}
    remarks = ("cameras are named cam0, cam1, ... as in the file: rename them in the rig file to the names of your images",)
    return Imported(cameras, base, base_is_camera=base != IMU, base_pose_required=True, remarks=remarks)


def _is_camera(key: Any) -> bool:
    return isinstance(key, str) and re.fullmatch(r"cam\d{1,4}", key) is not None


def _chained(chain: dict[Any, Any], names: list[str], path: Path) -> dict[str, Pose]:
    """Poses of the cameras in the frame of the first."""
    found = {names[0]: Pose.identity()}
    for before, name in pairwise(names):
        where = f"{path}: {name}"
        if isinstance(chain[name], dict) and "T_cn_cnm1" not in chain[name]:
            raise ValueError(f"{where}: 'T_cn_cnm1' is missing, so that its place relative to {before} is unknown")
        cam_from_before = pose_matrix(entry(chain[name], "T_cn_cnm1", where), f"{where}: T_cn_cnm1")
        found[name] = found[before] @ cam_from_before.inverse()
    return found


def _cam_from_imu(chain: dict[Any, Any], names: list[str], name: str, first_from_cam: dict[str, Pose], path: Path) -> Pose:
    """From the camera's own entry, or through the chain from the first camera that has one."""
    for known in (name, *names):
        if isinstance(chain[known], dict) and "T_cam_imu" in chain[known]:
            known_from_imu = pose_matrix(chain[known]["T_cam_imu"], f"{path}: {known}: T_cam_imu")
            return first_from_cam[name].inverse() @ first_from_cam[known] @ known_from_imu
    raise ValueError(f"{path}: no camera has 'T_cam_imu' (the file of a calibration with IMU has); take a camera as --base")


def _camera(data: Any, base_from_cam: Pose, where: str) -> Camera:
    model = entry(data, "camera_model", where)
    if model != "pinhole":
        raise ValueError(
            f"{where}: the camera model {short(model)} is not supported; calibrate with pinhole-radtan (or -equi: fisheye)"
        )
    fx, fy, cx, cy = numbers(entry(data, "intrinsics", where), f"{where}: intrinsics", 4)
    resolution = entry(data, "resolution", where)
    if not isinstance(resolution, list) or len(resolution) != 2:
        raise ValueError(f"{where}: resolution is [width, height], got {short(resolution)}")
    width, height = image_size(resolution[0], resolution[1], f"{where}: resolution")
    try:
        return Camera(intrinsics(fx, fy, cx, cy, _OPENCV_PIXEL_SHIFT), width, height, base_from_cam, _lens(data, where))
    except ValueError as error:
        raise ValueError(str(error) if str(error).startswith(where) else f"{where}: {error}") from error


def _lens(data: dict[str, Any], where: str) -> Lens:
    model = data.get("distortion_model", "none")
    if model == "none":
        return Pinhole()
    if model not in ("radtan", "equidistant"):
        raise ValueError(f"{where}: the distortion model {short(model)} is not supported; calibrate with radtan or equidistant")
    coefficients = numbers(entry(data, "distortion_coeffs", where), f"{where}: distortion_coeffs", 4)
    return opencv_lens(coefficients, where, fisheye=model == "equidistant")
