"""ROS 1 and ROS 2: CameraInfo and tf messages as ``rostopic echo`` or ``ros2 topic echo`` print them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from reprlib import repr as short
from typing import Any, Literal

import numpy as np

from coin3d.geometry import Camera, GroundPlane, Lens, Pinhole, Pose, camera_pose
from coin3d.geometry.rig import is_plausible_mount
from coin3d.rig_import.base import Imported
from coin3d.rig_import.fields import entry, image_size, intrinsics, numbers, opencv_lens, read_documents
from coin3d.rig_import.tf_tree import TfTree

CameraAxes = Literal["auto", "optical", "x-forward"]

_BASE = "base_link"
_OPENCV_PIXEL_SHIFT = 0.5
_MOST_FILES = 1000


def read_ros(source: Path, base: str | None, ego_from_base: Pose, camera_axes: CameraAxes, *, rectified: bool) -> Imported:
    """The cameras of all CameraInfo messages in the frame ``base``, by default ``base_link``.

    A camera is named like its file if the file holds one, otherwise like its frame without ``_optical_frame``.

    Args:
        source: a YAML file or a folder of them.
        base: frame of the vehicle in the tf tree.
        ego_from_base: where that is on the vehicle; tells plausible mounts from others.
        camera_axes: CameraInfo belongs to a frame with x right, y down, z forward (``optical``), but some drivers name the body
            frame, whose x is forward. ``auto`` takes them as optical and complains where only the other reading makes sense.
        rectified: describe the rectified images: P and R instead of K and D.

    Raises:
        ValueError: no CameraInfo or no tf in there, a broken message, a camera whose frame is not linked to the base, a model
            that is not supported, or camera axes that look wrong.
    """
    tree, found = TfTree(), dict[str, list[tuple[str, Any, str]]]()
    for path in _files(source):
        infos = list[tuple[Any, str]]()
        for number, document in enumerate(read_documents(path)):
            where = f"{path}: document {number + 1}"
            for i, transform in enumerate(_transforms(document, where)):
                tree.add(transform, f"{where}, transform {i + 1}")
            if isinstance(document, dict) and ("K" in document or "k" in document):
                infos.append((document, where))
            elif isinstance(document, dict) and "camera_matrix" in document:
                raise ValueError(
                    f"{where}: a calibration file without the camera's frame; record the topic instead: "
                    "ros2 topic echo --once /front/camera_info > front.yaml"
                )
        frames = {_frame_id(info, where) for info, where in infos}
        for info, where in infos:
            frame = _frame_id(info, where)
            name = path.stem if len(frames) == 1 else frame.removesuffix("_optical_frame").replace("/", "_")
            found.setdefault(name, []).append((frame, info, where))
    if not found:
        raise ValueError(f"{source}: no Kalibr chain, no COLMAP model, and no ROS CameraInfo (K and height) in its YAML files")
    base = (base or _BASE).lstrip("/")
    cameras: dict[str, Camera] = {}
    for name, messages in found.items():
        for frame, info, where in messages:
            place = f"{where}: camera '{name}'"
            base_from_frame = tree.target_from_source(base, frame, place)
            base_from_cam = _optical(base_from_frame, ego_from_base, camera_axes, frame, place)
            camera = _camera(info, base_from_cam, place, rectified=rectified)
            if not _same(cameras.setdefault(name, camera), camera):
                raise ValueError(f"{place}: contradicts {messages[0][2]}, another calibration of the same name")
    which = "rectified images (image_rect)" if rectified else "raw images (image_raw)"
    remarks = (
        f"the calibration is that of the {which}",
        f"positions start at {base}: --base-pose says where that is, if not on the ground",
    )
    return Imported(cameras, base, base_is_camera=False, base_pose_required=False, remarks=remarks)


def _files(source: Path) -> list[Path]:
    if source.is_file():
        return [source]
    files = sorted(p for p in source.iterdir() if p.suffix.lower() in (".yaml", ".yml") and p.is_file())
    if not files or len(files) > _MOST_FILES:
        raise ValueError(f"{source}: holds {len(files)} YAML files; expected dumps of CameraInfo and tf, at most {_MOST_FILES}")
    return files


def _transforms(document: Any, where: str) -> Iterator[Any]:
    if isinstance(document, dict) and "transforms" in document:
        if not isinstance(document["transforms"], list):
            raise ValueError(f"{where}: 'transforms' is a list")
        yield from document["transforms"]
    elif isinstance(document, dict) and "child_frame_id" in document and "transform" in document:
        yield document


def _frame_id(info: Any, where: str) -> str:
    frame = entry(entry(info, "header", where), "frame_id", f"{where}: header")
    if not isinstance(frame, str) or not frame.strip("/"):
        raise ValueError(f"{where}: header.frame_id is empty, so that the camera's place is unknown")
    return frame.lstrip("/")


def _same(one: Camera, other: Camera) -> bool:
    """Whether two messages of a camera agree."""
    sizes = [(camera.width_px, camera.height_px) for camera in (one, other)]
    alike = np.array_equal(one.K, other.K) and one.lens == other.lens and sizes[0] == sizes[1]
    return bool(alike and one.ego_from_cam.allclose(other.ego_from_cam))


def _optical(base_from_frame: Pose, ego_from_base: Pose, axes: CameraAxes, frame: str, where: str) -> Pose:
    """Pose of the camera with x right, y down, z forward."""
    x_forward = base_from_frame @ camera_pose((0.0, 0.0, 0.0))
    if axes == "x-forward":
        return x_forward
    makes_sense = [is_plausible_mount(ego_from_base @ pose, GroundPlane()) for pose in (base_from_frame, x_forward)]
    if axes == "auto" and makes_sense == [False, True]:
        raise ValueError(
            f"{where}: the frame '{frame}' has x forward, it seems, while that of a CameraInfo has z forward; add "
            "--camera-axes x-forward if the camera is level, or --camera-axes optical if it does look up or down"
        )
    return base_from_frame


def _camera(info: dict[str, Any], base_from_cam: Pose, where: str, *, rectified: bool) -> Camera:
    width, height = image_size(entry(info, "width", where), entry(info, "height", where), where)
    _whole_image(info, width, height, where)
    lens: Lens = Pinhole()
    if rectified:
        P = numbers(_either(info, "P", where), f"{where}: P", 12)
        R = np.reshape(numbers(_either(info, "R", where), f"{where}: R", 9), (3, 3))
        fx, cx, fy, cy = P[0], P[2], P[5], P[6]
    else:
        K = numbers(_either(info, "K", where), f"{where}: K", 9)
        fx, cx, fy, cy = K[0], K[2], K[4], K[5]
        lens = _lens(info, where)
    if fx == 0 or fy == 0:
        raise ValueError(
            f"{where}: the focal length is 0: this camera was never calibrated, or has no {'P' if rectified else 'K'}"
        )
    try:
        if rectified:
            base_from_cam = base_from_cam @ Pose(R, np.zeros(3)).inverse()
        return Camera(intrinsics(fx, fy, cx, cy, _OPENCV_PIXEL_SHIFT), width, height, base_from_cam, lens)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error


def _whole_image(info: dict[str, Any], width: int, height: int, where: str) -> None:
    roi = info.get("roi", {})
    binned = [info.get(key, 0) not in (0, 1) for key in ("binning_x", "binning_y")]
    cut = isinstance(roi, dict) and (
        roi.get("x_offset", 0)
        or roi.get("y_offset", 0)
        or roi.get("width", 0) not in (0, width)
        or roi.get("height", 0) not in (0, height)
    )
    if any(binned) or cut:
        raise ValueError(
            f"{where}: binning or a region of interest is set, which import does not apply; record the camera's full image, or "
            "type K and size of what you have into the rig file (docs/your_rig.md)"
        )


def _lens(info: dict[str, Any], where: str) -> Lens:
    coefficients = numbers(_either(info, "D", where), f"{where}: D")
    model = info.get("distortion_model", "")
    if model == "equidistant":
        return opencv_lens(coefficients, f"{where}: D", fisheye=True)
    if not any(coefficients):
        return Pinhole()
    if model not in ("plumb_bob", "rational_polynomial"):
        raise ValueError(
            f"{where}: the distortion model {short(model)} is not supported, only plumb_bob, rational_polynomial, equidistant"
        )
    if len(coefficients) not in {"plumb_bob": (4, 5), "rational_polynomial": (8, 12, 14)}[model]:
        raise ValueError(f"{where}: {len(coefficients)} coefficients do not fit the distortion model {model}")
    return opencv_lens(coefficients, f"{where}: D")


def _either(info: dict[str, Any], key: str, where: str) -> Any:
    """The field of ROS 1 (capital) or ROS 2."""
    return info[key.lower()] if key.lower() in info else entry(info, key, where)
