"""Reading calibration files of unknown origin: bounded in size, every complaint with the place."""

from __future__ import annotations

from pathlib import Path
from reprlib import repr as short
from typing import Any

import numpy as np
from jaxtyping import Float

from coin3d.geometry import BrownConrady, Fisheye, Lens, Pinhole, Pose
from coin3d.yaml_documents import LARGEST_BYTES, read_yaml

_LARGEST_SIDE_PX = 32767


def read_text(path: Path) -> str:
    """The text of a calibration file.

    Raises:
        ValueError: larger than 1 MiB, or not text.
    """
    if path.stat().st_size > LARGEST_BYTES:
        raise ValueError(f"{path}: {path.stat().st_size / 2**20:.1f} MiB is too large for a calibration (limit 1 MiB)")
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: not a text file ({error})") from error


def read_documents(path: Path) -> list[Any]:
    """The documents of a YAML file, which ``---`` separates; empty ones are left out.

    Raises:
        ValueError: not YAML.
    """
    return [document for document in read_yaml(read_text(path), str(path)) if document is not None]


def entry(data: Any, key: str, where: str) -> Any:
    """``data[key]``; raises ValueError if there is none."""
    if not isinstance(data, dict) or key not in data:
        raise ValueError(f"{where}: '{key}' is missing")
    return data[key]


def numbers(value: Any, where: str, count: int | None = None) -> list[float]:
    """A list of finite numbers; raises ValueError for anything else, or for another count."""
    if not isinstance(value, list) or any(isinstance(v, bool) or not isinstance(v, (int, float)) for v in value):
        raise ValueError(f"{where} is a list of numbers, got {short(value)}")
    if count is not None and len(value) != count:
        raise ValueError(f"{where} holds {count} numbers, got {len(value)}")
    try:
        found = [float(v) for v in value]
    except OverflowError as error:
        raise ValueError(f"{where} holds a number that is too large") from error
    if not np.isfinite(found).all():
        raise ValueError(f"{where} holds a number that is not finite")
    return found


def image_size(width: Any, height: Any, where: str) -> tuple[int, int]:
    """Width and height of an image in pixels; raises ValueError unless they are whole numbers from 1 to 32767."""
    for side in (width, height):
        if isinstance(side, bool) or not isinstance(side, int) or not 1 <= side <= _LARGEST_SIDE_PX:
            raise ValueError(
                f"{where}: an image size is two whole numbers from 1 to {_LARGEST_SIDE_PX}, "
                f"got {short(width)} x {short(height)}"
            )
    return width, height


def pose_matrix(value: Any, where: str) -> Pose:
    """A pose from four lists of four numbers; raises ValueError for anything else."""
    if not isinstance(value, list) or len(value) != 4:
        raise ValueError(f"{where} is a 4 x 4 matrix, got {short(value)}")
    rows = [numbers(row, f"{where}, row {i + 1}", 4) for i, row in enumerate(value)]
    try:
        return Pose.from_matrix(rows)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error


def intrinsics(fx: float, fy: float, cx: float, cy: float, pixel_shift: float) -> Float[np.ndarray, "3 3"]:
    """K of this project, whose first pixel has its centre at 0.5: ``pixel_shift`` 0.5 for OpenCV's K, 0 for COLMAP's."""
    return np.array([[fx, 0, cx + pixel_shift], [0, fy, cy + pixel_shift], [0, 0, 1]])


def opencv_lens(coefficients: list[float], where: str, *, fisheye: bool = False) -> Lens:
    """A lens from coefficients in OpenCV's order; a pinhole if all are zero and it is no fisheye.

    Raises:
        ValueError: a number of coefficients that is not supported, or a lens that makes no sense.
    """
    try:
        if fisheye:
            if len(coefficients) != 4:
                raise ValueError(f"a fisheye has 4 coefficients, got {len(coefficients)}")
            return Fisheye(*coefficients)
        if not any(coefficients):
            return Pinhole()
        while len(coefficients) > 8 and coefficients[-1] == 0:  # thin prism and tilt, left at zero
            coefficients = coefficients[:-1]
        if len(coefficients) not in (4, 5, 8):
            raise ValueError(f"4, 5 or 8 distortion coefficients are supported, got {len(coefficients)}")
        return BrownConrady(*coefficients)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error
