"""Where the pixels of a frame come from: memory, an image file, or bytes inside a larger file."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol, runtime_checkable

import cv2
import numpy as np
from jaxtyping import UInt8


@runtime_checkable
class LazyImage(Protocol):
    """Pixels that are read when asked for. ``str()`` of it says where from, for messages."""

    def load(self) -> UInt8[np.ndarray, "h w 3"]:
        """The RGB image; raises ValueError where it is missing or damaged."""
        ...


ImageSource = Path | np.ndarray | LazyImage
"""Where an image comes from: a file, pixels already in memory (rendered frames), or whatever a format needs."""


def load_image(source: ImageSource) -> np.ndarray:
    """The pixels of a source: (H, W, 3) RGB, or whatever shape an array in memory has.

    Raises:
        ValueError: missing, truncated or not an image.
    """
    if isinstance(source, np.ndarray):
        return source
    return read_image(source) if isinstance(source, Path) else source.load()


def read_image(path: Path) -> UInt8[np.ndarray, "h w 3"]:
    """Read an image file as RGB.

    Raises:
        ValueError: missing, truncated or not an image.
    """
    if not path.is_file():
        raise ValueError(f"{path}: the image file is missing")
    return decode_image(np.fromfile(path, dtype=np.uint8), str(path))


def decode_image(data: UInt8[np.ndarray, "n"], where: str) -> UInt8[np.ndarray, "h w 3"]:
    """Decode the bytes of a JPEG or PNG as RGB.

    Args:
        data: the encoded image.
        where: names it in errors.

    Raises:
        ValueError: truncated or not an image.
    """
    if data[:2].tobytes() == b"\xff\xd8" and b"\xff\xd9" not in data[-64:].tobytes():
        raise ValueError(f"{where}: the JPEG is truncated (no end marker); copy it again")
    pixels = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    if pixels is None:
        raise ValueError(f"{where}: cannot be decoded as an image; is the file complete?")
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB))
