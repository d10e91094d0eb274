"""rig.yaml: a rig that a person can type. The format is described in docs/your_rig.md."""

from __future__ import annotations

from pathlib import Path
from reprlib import repr as short
from typing import Any

import numpy as np
import yaml

from coin3d.geometry.camera import Camera
from coin3d.geometry.ground import GroundPlane
from coin3d.geometry.lens import Lens, Pinhole
from coin3d.geometry.lens_brown_conrady import BrownConrady
from coin3d.geometry.lens_fisheye import Fisheye
from coin3d.geometry.pose import Pose, camera_pose
from coin3d.geometry.rig import Rig
from coin3d.records import write_bytes
from coin3d.yaml_documents import LARGEST_BYTES, read_yaml

_RIG_KEYS = {"name", "cameras", "pixel_origin", "ground", "ego_from_vehicle"}
_CAMERA_KEYS = {
    "size", "K", "focal", "centre", "fov_deg", "position", "yaw_deg", "pitch_deg", "roll_deg", "vehicle_from_cam", "quaternion",
    "distortion", "fisheye",
}  # fmt: skip
_PIXEL_ORIGINS = {"opencv": 0.5, "edge": 0.0}
_LARGEST_SIDE_PX = 32767


def load_rig(path: Path | str) -> Rig:
    """Read a rig file.

    Raises:
        ValueError: anything missing, unknown or contradictory, naming the file, the camera and the remedy.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such rig file; docs/your_rig.md shows one")
    if path.stat().st_size > LARGEST_BYTES:
        raise ValueError(f"{path}: {path.stat().st_size / 2**20:.1f} MiB is too large for a rig file (limit 1 MiB)")
    try:
        documents = read_yaml(path.read_text(encoding="utf-8"), str(path))
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: not readable as YAML: {error}") from error
    if len(documents) > 1:
        raise ValueError(f"{path}: holds {len(documents)} YAML documents; a rig file is one, without '---' between")
    try:
        return rig_from_dict(documents[0] if documents else None, default_name=path.stem)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def save_rig(rig: Rig, path: Path | str) -> None:
    """Write a rig file that ``load_rig`` reads back exactly."""
    write_bytes(Path(path), yaml.safe_dump(rig_to_dict(rig), sort_keys=False).encode())


def rig_from_dict(data: Any, default_name: str = "rig") -> Rig:
    """Build a rig from the parsed content of a rig file."""
    if not isinstance(data, dict) or not isinstance(data.get("cameras"), dict) or not data["cameras"]:
        raise ValueError("a rig file holds 'cameras:' with one entry per camera; docs/your_rig.md shows one")
    _no_unknown_keys(data, _RIG_KEYS, "the rig")
    origin = data.get("pixel_origin", "opencv")
    if not isinstance(origin, str) or origin not in _PIXEL_ORIGINS:
        raise ValueError(f"pixel_origin is 'opencv' (pixel centres at whole numbers) or 'edge', got {short(origin)}")
    ego_from_vehicle = _pose(data["ego_from_vehicle"], "ego_from_vehicle") if "ego_from_vehicle" in data else Pose.identity()
    cameras = {
        str(name): _camera(str(name), entry, _PIXEL_ORIGINS[origin], ego_from_vehicle)
        for name, entry in data["cameras"].items()
    }
    name = data.get("name", default_name)
    if not isinstance(name, (str, int, float)):
        raise ValueError(f"name is a text, got {short(name)}")
    return Rig(cameras, _ground(data.get("ground")), ego_from_vehicle, str(name))


def rig_to_dict(rig: Rig) -> dict[str, Any]:
    """The content of the rig's file; inverse of ``rig_from_dict``."""
    vehicle_from_ego = rig.ego_from_vehicle.inverse()
    data: dict[str, Any] = {"name": rig.name, "pixel_origin": "edge", "cameras": {}}
    if not rig.ego_from_vehicle.allclose(Pose.identity(), atol=0):
        data["ego_from_vehicle"] = rig.ego_from_vehicle.matrix.tolist()
    if not rig.ground.is_default:
        data["ground"] = {"normal": rig.ground.normal.tolist(), "offset": rig.ground.offset_m}
    for name, camera in rig.items():
        data["cameras"][name] = {
            "size": [camera.width_px, camera.height_px],
            "K": camera.K.tolist(),
            **_lens_entry(camera.lens, name),
            "vehicle_from_cam": (vehicle_from_ego @ camera.ego_from_cam).matrix.tolist(),
        }
    return data


def _camera(name: str, entry: Any, pixel_shift: float, ego_from_vehicle: Pose) -> Camera:
    where = f"camera '{name}'"
    if not isinstance(entry, dict):
        raise ValueError(f"{where}: expected keys such as size, focal, position, yaw_deg, got {short(entry)}")
    _no_unknown_keys(entry, _CAMERA_KEYS, where)
    width, height = _numbers(entry, "size", 2, where)
    if not all(side == int(side) and side <= _LARGEST_SIDE_PX for side in (width, height)):
        raise ValueError(f"{where}: 'size' is whole pixels, at most {_LARGEST_SIDE_PX} a side, got {short(entry['size'])}")
    try:
        K = _intrinsics(entry, width, height, pixel_shift, where)
        vehicle_from_cam = _mount(entry, where)
        return Camera(K, int(width), int(height), ego_from_vehicle @ vehicle_from_cam, _lens(entry, where))
    except ValueError as error:
        message = str(error)
        raise ValueError(message if message.startswith(where) else f"{where}: {message}") from error


def _intrinsics(entry: dict[str, Any], width: float, height: float, pixel_shift: float, where: str) -> np.ndarray:
    given = [key for key in ("K", "focal", "fov_deg") if key in entry]
    if len(given) != 1:
        raise ValueError(f"{where}: give exactly one of K, focal, fov_deg (found: {', '.join(given) or 'none'})")
    if "K" in entry:
        K = _matrix(entry["K"], (3, 3), f"{where}: K")
        K[:2, 2] += pixel_shift
        return K
    if "fov_deg" in entry:
        fov = _numbers(entry, "fov_deg", 1, where)[0]
        if not 0 < fov < 180:
            raise ValueError(f"{where}: fov_deg is the horizontal field of view between 0 and 180, got {fov:g}")
        fx = fy = width / 2 / np.tan(np.deg2rad(fov) / 2)
    elif isinstance(entry["focal"], list):
        fx, fy = _numbers(entry, "focal", 2, where)
    else:
        fx = fy = _numbers(entry, "focal", 1, where)[0]
    centre = np.array([width / 2, height / 2])
    if "centre" in entry:
        centre = np.array(_numbers(entry, "centre", 2, where)) + pixel_shift
    return np.array([[fx, 0, centre[0]], [0, fy, centre[1]], [0, 0, 1]])


def _lens(entry: dict[str, Any], where: str) -> Lens:
    given = [key for key in ("distortion", "fisheye") if key in entry]
    if not given:
        return Pinhole()
    if len(given) == 2:
        raise ValueError(f"{where}: give distortion (ordinary lens) or fisheye, not both")
    if "fov_deg" in entry:
        raise ValueError(f"{where}: with {given[0]} say how long the lens is by K or focal; fov_deg is for straight images")
    if given == ["fisheye"]:
        return Fisheye(*_numbers(entry, "fisheye", 4, where))
    count = len(entry["distortion"]) if isinstance(entry["distortion"], list) else 1
    if count not in (4, 5, 8):
        raise ValueError(
            f"{where}: 'distortion' is [k1, k2, p1, p2], [k1, k2, p1, p2, k3] or with k4, k5, k6 behind, as OpenCV has it, got "
            f"{short(entry['distortion'])}"
        )
    return BrownConrady(*_numbers(entry, "distortion", count, where))


def _lens_entry(lens: Lens, name: str) -> dict[str, list[float]]:
    if isinstance(lens, Pinhole):
        return {}
    if isinstance(lens, (BrownConrady, Fisheye)):
        return {"fisheye" if isinstance(lens, Fisheye) else "distortion": list(lens.coefficients)}
    raise ValueError(f"camera '{name}' has the lens {lens}, which rig files cannot hold")


def _mount(entry: dict[str, Any], where: str) -> Pose:
    if "vehicle_from_cam" in entry:
        extra = [k for k in ("position", "yaw_deg", "pitch_deg", "roll_deg", "quaternion") if k in entry]
        if extra:
            raise ValueError(f"{where}: vehicle_from_cam already says where the camera is; remove {', '.join(extra)}")
        return _pose(entry["vehicle_from_cam"], f"{where}: vehicle_from_cam")
    position = _numbers(entry, "position", 3, where)
    if "quaternion" in entry:
        return Pose.from_quaternion(_numbers(entry, "quaternion", 4, where), position)
    if "yaw_deg" not in entry:
        raise ValueError(f"{where}: say where it looks: yaw_deg (0 forward, 90 left), or quaternion, or vehicle_from_cam")
    angles = ("yaw_deg", "pitch_deg", "roll_deg")
    yaw, pitch, roll = (np.deg2rad(_numbers({k: entry.get(k, 0)}, k, 1, where)[0]) for k in angles)
    return camera_pose(position, yaw, pitch, roll)


def _ground(entry: Any) -> GroundPlane:
    if entry is None:
        return GroundPlane()
    if not isinstance(entry, dict) or set(entry) != {"normal", "offset"}:
        raise ValueError("ground: needs 'normal: [x, y, z]' and 'offset: metres' (normal . p + offset = 0)")
    return GroundPlane(np.array(_numbers(entry, "normal", 3, "ground")), _numbers(entry, "offset", 1, "ground")[0])


def _numbers(entry: dict[str, Any], key: str, count: int, where: str) -> list[float]:
    if key not in entry:
        raise ValueError(f"{where}: '{key}' is missing")
    value = entry[key] if isinstance(entry[key], list) else [entry[key]]
    if len(value) != count or not all(map(_is_number, value)):
        raise ValueError(f"{where}: '{key}' takes {count} number{'s' * (count > 1)}, got {short(entry[key])}")
    try:
        numbers = [float(v) for v in value]
    except OverflowError as error:
        raise ValueError(f"{where}: '{key}' holds a number that is too large") from error
    if not np.isfinite(numbers).all():
        raise ValueError(f"{where}: '{key}' holds a number that is not finite")
    return numbers


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _matrix(value: Any, shape: tuple[int, int], where: str) -> np.ndarray:
    # aliases of YAML can make a short file an enormous list: nothing is copied or printed before its size is known
    rows = value if isinstance(value, list) and len(value) <= 16 else [value]
    if not all(_is_number(row) or (isinstance(row, list) and len(row) <= 16 and all(map(_is_number, row))) for row in rows):
        raise ValueError(f"{where} is not a matrix of numbers: {short(value)}")
    try:
        matrix = np.array(value, dtype=np.float64)
    except (ValueError, TypeError, OverflowError) as error:
        raise ValueError(f"{where} is not a matrix of numbers: {short(value)}") from error
    if matrix.shape != shape:
        raise ValueError(f"{where} is a {shape[0]} x {shape[1]} matrix, got shape {matrix.shape}")
    return matrix


def _pose(value: Any, where: str) -> Pose:
    try:
        return Pose.from_matrix(_matrix(value, (4, 4), where))
    except ValueError as error:
        raise ValueError(str(error) if str(error).startswith(where) else f"{where}: {error}") from error


def _no_unknown_keys(entry: dict[str, Any], allowed: set[str], where: str) -> None:
    unknown = sorted(set(map(str, entry)) - allowed)
    if unknown:
        raise ValueError(f"{where} has unknown keys {', '.join(unknown)}; known are {', '.join(sorted(allowed))}")
