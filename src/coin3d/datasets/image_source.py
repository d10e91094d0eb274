"""Where the pixels of a frame come from: memory, an image file, or bytes inside a larger file."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol, runtime_checkable

import cv2
import numpy as np
import simplejpeg
from jaxtyping import UInt8

REDUCTIONS = (8, 4, 2)
"""How many times smaller images can be read; for a JPEG that is cheap, it takes the coarse part of its coefficients alone."""

_REDUCED = {1: cv2.IMREAD_COLOR, 2: cv2.IMREAD_REDUCED_COLOR_2, 4: cv2.IMREAD_REDUCED_COLOR_4, 8: cv2.IMREAD_REDUCED_COLOR_8}
_JPEG = b"\xff\xd8"
_EXIF = b"Exif\0\0"
_PNG = b"\x89PNG\r\n\x1a\n"
_FRAME_HEADERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of a JPEG after which its size stands (ITU-T T.81, table B.1)."""

_MOST_PIXELS = 1 << 27  # no camera on a vehicle has 134 million


@runtime_checkable
class LazyImage(Protocol):
    """Pixels that are read when asked for. ``str()`` of it says where from, for messages."""

    def load(self, reduction: int = 1) -> UInt8[np.ndarray, "h w 3"]:
        """The RGB image, ``reduction`` (1, 2, 4 or 8) times smaller; raises ValueError where it is missing or damaged."""
        ...


ImageSource = Path | np.ndarray | LazyImage
"""Where an image comes from: a file, pixels already in memory (rendered frames), or whatever a format needs."""


def load_image(source: ImageSource, reduction: int = 1) -> np.ndarray:
    """The pixels of a source: (H, W, 3) RGB, or whatever shape an array in memory has.

    Args:
        source: where from.
        reduction: 1, 2, 4 or 8; they come that many times smaller.

    Raises:
        ValueError: missing, truncated or not an image.
    """
    if isinstance(source, np.ndarray):
        return _averaged(source, reduction)
    return read_image(source, reduction) if isinstance(source, Path) else source.load(reduction)


def read_image(path: Path, reduction: int = 1) -> UInt8[np.ndarray, "h w 3"]:
    """Read an image file as RGB.

    Raises:
        ValueError: missing, truncated or not an image.
    """
    if not path.is_file():
        raise ValueError(f"{path}: the image file is missing")
    return decode_image(np.fromfile(path, dtype=np.uint8), str(path), reduction)


def decode_image(data: UInt8[np.ndarray, "n"], where: str, reduction: int = 1) -> UInt8[np.ndarray, "h w 3"]:
    """Decode the bytes of a JPEG or PNG as RGB.

    Args:
        data: the encoded image.
        where: names it in errors.
        reduction: 1, 2, 4 or 8; it comes that many times smaller. Its sides should be multiples of it.

    Raises:
        ValueError: truncated, not an image, or one that says it is absurdly large.
    """
    is_jpeg = data[:2].tobytes() == _JPEG
    if is_jpeg and b"\xff\xd9" not in data[-64:].tobytes():
        raise ValueError(f"{where}: the JPEG is truncated (no end marker); copy it again")
    width, height = _announced_size(data)
    if width * height > _MOST_PIXELS:
        raise ValueError(f"{where}: says that it is an image of {width} x {height} pixels; is the file damaged?")
    least_px = (-(-width // reduction), -(-height // reduction))
    if is_jpeg and all(least_px) and (pixels := _jpeg(data, least_px)) is not None:
        return pixels
    try:
        pixels = cv2.imdecode(data, _REDUCED[reduction if is_jpeg else 1]) if data.size else None
    except cv2.error:
        pixels = None
    if pixels is None:
        raise ValueError(f"{where}: cannot be decoded as an image; is the file complete?")
    rgb = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB, dst=pixels))
    return rgb if is_jpeg else _averaged(rgb, reduction)


def _jpeg(data: UInt8[np.ndarray, "n"], least_px: tuple[int, int]) -> UInt8[np.ndarray, "h w 3"] | None:
    """What OpenCV gives, in less time; None where OpenCV is needed, for it turns pictures upright and forgives.

    The smallest size of at least so many pixels that the decoder can give, which is a reduction by 1, 2, 4 or 8 exactly where
    ``least_px`` is one. It must be known: the decoder would take memory for whatever it finds, and not reduce at all.
    """
    if _EXIF in data[:64].tobytes():
        return None
    try:
        return np.asarray(simplejpeg.decode_jpeg(data, "RGB", min_width=least_px[0], min_height=least_px[1]))
    except ValueError:
        return None


def _announced_size(data: UInt8[np.ndarray, "n"]) -> tuple[int, int]:
    """Width and height that a PNG or JPEG says it has, (0, 0) where it does not; decoders take memory for it at once."""
    if data[:8].tobytes() == _PNG:
        header = data[16:24].tobytes()
        return int.from_bytes(header[:4]), int.from_bytes(header[4:])
    at = 2
    while data[:2].tobytes() == _JPEG and at + 9 <= len(data) and data[at] == 0xFF:
        marker, length = int(data[at + 1]), int.from_bytes(data[at + 2 : at + 4].tobytes())
        if marker in _FRAME_HEADERS:
            return int.from_bytes(data[at + 7 : at + 9].tobytes()), int.from_bytes(data[at + 5 : at + 7].tobytes())
        at += 1 if marker == 0xFF else 2 + length
    return 0, 0


def _averaged(image: np.ndarray, reduction: int) -> np.ndarray:
    if reduction == 1:
        return image
    size_px = (-(-image.shape[1] // reduction), -(-image.shape[0] // reduction))
    return np.asarray(cv2.resize(image, size_px, interpolation=cv2.INTER_AREA))


def reduction_to(size_px: tuple[int, int], at_least_px: tuple[int, int]) -> int:
    """How many times smaller an image may be decoded and still have ``at_least_px`` (width, height): 1, 2, 4 or 8.

    Only divisors of both sides: the edges of the image then stay where they are, and so does the camera.
    """
    for reduction in REDUCTIONS:
        if all(side % reduction == 0 and side // reduction >= least for side, least in zip(size_px, at_least_px, strict=True)):
            return reduction
    return 1
