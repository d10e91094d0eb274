"""COLMAP's text model: ``cameras.txt`` (lenses) and ``images.txt`` (poses), in a frame and a unit of its own."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from coin3d.geometry import BrownConrady, Camera, Fisheye, Lens, Pinhole, Pose
from coin3d.rig_import.base import Imported
from coin3d.rig_import.fields import image_size, intrinsics, numbers

# COLMAP's image starts at the corner of its first pixel, as ours does
_PIXEL_SHIFT = 0.0
_LONGEST_LINE = 2**26
_MOST_CAMERAS = 100
_MOST_FRAMES = 200
"""Poses relative to the base are taken from at most this many frames, evenly spread."""


@dataclass(frozen=True, eq=False)
class _Intrinsics:
    K: np.ndarray
    width_px: int
    height_px: int
    lens: Lens


@dataclass(frozen=True, eq=False)
class _Image:
    cam_from_world: Pose
    camera_id: str


def is_colmap(source: Path) -> bool:
    """Whether a folder looks like a COLMAP model."""
    return source.is_dir() and any((source / name).is_file() for name in ("cameras.txt", "images.txt", "cameras.bin"))


def read_colmap(source: Path, base: str | None, scale: float | None) -> Imported:
    """The cameras of a model in the frame of the camera ``base``, by default the first by name.

    An image ``front/0001.jpg`` belongs to the camera ``front`` and the frame ``0001``; an image ``front.jpg`` to the camera
    ``front``. Of many frames the median position and the most central rotation relative to the base are taken.

    Args:
        source: folder with the two files.
        base: name of a camera.
        scale: metres per unit of the model; needed for more than one camera.

    Raises:
        ValueError: files missing or broken, a camera model that is not supported, cameras that share no frame with the base, or
            no scale.
    """
    if not (source / "cameras.txt").is_file() or not (source / "images.txt").is_file():
        raise ValueError(
            f"{source}: needs cameras.txt and images.txt; convert a binary model by: "
            "colmap model_converter --input_path MODEL --output_path TEXT --output_type TXT"
        )
    if scale is not None and not (np.isfinite(scale) and scale > 0):
        raise ValueError(f"--scale is metres per unit of the model, more than 0, got {scale:g}")
    lenses = _read_cameras(source / "cameras.txt")
    images = _read_images(source / "images.txt")
    names = sorted(images)
    if len(names) > _MOST_CAMERAS:
        raise ValueError(
            f"{source}: images of {len(names)} cameras ({', '.join(names[:3])}, ...); put the images of a camera into a folder "
            "with its name, front/0001.jpg, and reconstruct again (option --ImageReader.single_camera_per_folder 1)"
        )
    base = names[0] if base is None else base
    if base not in images:
        raise ValueError(f"{source}: no camera '{base}'; --base is one of {', '.join(names)}")
    cameras, remarks = {}, []
    for name in names:
        shared = sorted(images[name].keys() & images[base].keys())
        if not shared:
            raise ValueError(
                f"{source}: no frame has images of both '{name}' and '{base}'; take another --base, or rename images"
            )
        chosen = [shared[i] for i in np.unique(np.linspace(0, len(shared) - 1, _MOST_FRAMES).astype(int))]
        poses = [images[base][f].cam_from_world @ images[name][f].cam_from_world.inverse() for f in chosen]
        pose, spread, spread_deg = _typical(poses)
        if name != base and scale is None:
            raise ValueError(
                f"{source}: a COLMAP model has no unit. Add --scale, metres per unit: a distance that you measured, divided by "
                f"the model's; it puts '{name}' {np.linalg.norm(pose.translation):.4g} units from '{base}'"
            )
        used = {image.camera_id for image in images[name].values()}
        if len(used) > 1 or not used <= lenses.keys():
            raise ValueError(
                f"{source}: images of '{name}' have the camera ids {', '.join(sorted(used))}; one of cameras.txt is needed"
            )
        seen = lenses[used.pop()]
        metres = 1.0 if scale is None else scale
        placed = Pose(pose.rotation, pose.translation * metres)
        cameras[name] = Camera(seen.K, seen.width_px, seen.height_px, placed, seen.lens)
        if name != base:
            of = f"{len(chosen)} frames, which differ by up to {spread * metres:.3f} m and {spread_deg:.2f} degrees"
            remarks.append(f"{name}: placed relative to {base} by {of if len(chosen) > 1 else '1 frame'}")
    return Imported(cameras, base, base_is_camera=True, base_pose_required=True, remarks=tuple(remarks))


def _typical(poses: list[Pose]) -> tuple[Pose, float, float]:
    """Median position with the rotation that is nearest to all others, and the largest deviations (units, degrees)."""
    rotations = np.stack([pose.rotation for pose in poses])
    cosines = (np.einsum("aij,bij->ab", rotations, rotations) - 1) / 2
    degrees = np.rad2deg(np.arccos(np.clip(cosines, -1, 1)))
    central = int(degrees.sum(1).argmin())
    positions = np.stack([pose.translation for pose in poses])
    middle = np.median(positions, axis=0)
    return (
        Pose(rotations[central], middle),
        float(np.linalg.norm(positions - middle, axis=1).max()),
        float(degrees[central].max()),
    )


def _read_cameras(path: Path) -> dict[str, _Intrinsics]:
    found: dict[str, _Intrinsics] = {}
    for where, line in _lines(path):
        words = line.split()
        if not words:
            continue
        if len(words) < 5:
            raise ValueError(f"{where}: CAMERA_ID MODEL WIDTH HEIGHT PARAMS are expected, got {line[:80]!r}")
        if words[0] in found:
            raise ValueError(f"{where}: the camera id {words[0]} a second time")
        width, height = (int(word) if word.isdecimal() and len(word) < 8 else 0 for word in words[2:4])
        size = image_size(width, height, where)
        params = _floats(words[4:], where)
        try:
            K, lens = _model(words[1], params)
        except ValueError as error:
            raise ValueError(f"{where}: {error}") from error
        found[words[0]] = _Intrinsics(K, *size, lens)
    return found


def _model(name: str, params: list[float]) -> tuple[np.ndarray, Lens]:
    """K and lens of a camera model by COLMAP's names, parameters in COLMAP's order."""
    counts = {"SIMPLE_PINHOLE": 3, "PINHOLE": 4, "SIMPLE_RADIAL": 4, "RADIAL": 5, "OPENCV": 8, "FULL_OPENCV": 12,
              "OPENCV_FISHEYE": 8, "SIMPLE_RADIAL_FISHEYE": 4, "RADIAL_FISHEYE": 5}  # fmt: skip
    if name not in counts:
        raise ValueError(f"the camera model {name} is not supported, only {', '.join(counts)}")
    if len(params) != counts[name]:
        raise ValueError(f"the camera model {name} has {counts[name]} parameters, got {len(params)}")
    one_focal = name.startswith(("SIMPLE_", "RADIAL"))
    fx, fy, cx, cy = (params[0], params[0], *params[1:3]) if one_focal else params[:4]
    if not min(fx, fy) > 0:
        raise ValueError(f"a focal length is more than 0, got {min(fx, fy):g}")
    rest = params[3:] if one_focal else params[4:]
    K = intrinsics(fx, fy, cx, cy, _PIXEL_SHIFT)
    if not rest:
        return K, Pinhole()
    if name.endswith("FISHEYE"):
        return K, Fisheye(*rest, *[0.0] * (4 - len(rest)))
    if one_focal:
        rest = [*rest, *[0.0] * (4 - len(rest))]  # k1 (k2), no tangential part
    return K, BrownConrady(*rest) if any(rest) else Pinhole()


def _read_images(path: Path) -> dict[str, dict[str, _Image]]:
    """Camera name -> frame name -> image. Every second line lists points and is skipped; it may be empty."""
    found: dict[str, dict[str, _Image]] = {}
    points_next = False
    for where, line in _lines(path):
        if points_next:
            points_next = False
            continue
        words = line.split(maxsplit=9)
        if not words:
            continue
        if len(words) != 10:
            raise ValueError(f"{where}: IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME are expected, got {line[:80]!r}")
        pose = _floats(words[1:8], where)
        name = PurePosixPath(words[9].strip().replace("\\", "/"))
        camera, frame = (name.parent.name, name.stem) if name.parent.name else (name.stem, "")
        if frame in found.setdefault(camera, {}):
            raise ValueError(f"{where}: a second image of the camera '{camera}' in the frame '{frame}': {name}")
        try:
            found[camera][frame] = _Image(Pose.from_quaternion(pose[:4], pose[4:]), words[8])
        except ValueError as error:
            raise ValueError(f"{where}: {error}") from error
        points_next = True
    if not found:
        raise ValueError(f"{path}: no image is registered")
    return found


def _lines(path: Path) -> Iterator[tuple[str, str]]:
    """Lines that are no comments, each with where it is."""
    with path.open(encoding="utf-8", errors="replace") as file:
        for number in range(1, 2**62):
            line = file.readline(_LONGEST_LINE)
            if not line:
                return
            if len(line) == _LONGEST_LINE:
                raise ValueError(f"{path}, line {number}: longer than {_LONGEST_LINE} characters; is this a text model?")
            if not line.startswith("#"):
                yield f"{path}, line {number}", line.rstrip("\r\n")


def _floats(words: list[str], where: str) -> list[float]:
    try:
        return numbers([float(word) for word in words], where)
    except ValueError as error:
        message = str(error)
        raise ValueError(message if message.startswith(where) else f"{where}: {message}") from error
