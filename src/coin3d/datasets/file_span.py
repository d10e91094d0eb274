"""Bytes inside a larger file: remembered by place, read when asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from coin3d.datasets.image_source import decode_image


@dataclass(frozen=True)
class FileStamp:
    """What tells a file from what it was before: size in bytes and time of its last change."""

    size: int
    mtime_ns: int

    @classmethod
    def of(cls, path: Path) -> FileStamp:
        """The stamp of a file now.

        Raises:
            FileNotFoundError: no such file.
        """
        if not path.is_file():
            raise FileNotFoundError(f"{path}: this file of the recording is missing")
        status = path.stat()
        return cls(status.st_size, status.st_mtime_ns)


@dataclass(frozen=True)
class FileSpan:
    """A range of bytes of a file as it was when the range was found.

    Args:
        path: the file.
        stamp: of the file then.
        start: first byte.
        length: number of bytes.
    """

    path: Path
    stamp: FileStamp
    start: int
    length: int

    def __post_init__(self) -> None:
        if self.start < 0 or self.length < 0 or self.start + self.length > self.stamp.size:
            raise ValueError(
                f"{self.path}: bytes {self.start} to {self.start + self.length} of a file of {self.stamp.size}: it is cut "
                "short; copy it again"
            )

    def within(self, start: int, end: int) -> FileSpan:
        """A part of this range, counted from its first byte."""
        if not 0 <= start <= end <= self.length:
            raise ValueError(f"{self.path}: bytes {start} to {end} of a range of {self.length}")
        return FileSpan(self.path, self.stamp, self.start + start, end - start)

    def read(self) -> bytes:
        """The bytes.

        Raises:
            FileNotFoundError: the file is gone.
            ValueError: the file was changed after the range was found.
        """
        if FileStamp.of(self.path) != self.stamp:
            raise ValueError(f"{self.path}: the file was changed while it was in use; open the recording again")
        with self.path.open("rb") as file:
            file.seek(self.start)
            content = file.read(self.length)
        if len(content) < self.length:
            raise ValueError(f"{self.path}: only {len(content)} of {self.length} bytes at {self.start} could be read")
        return content


@dataclass(frozen=True)
class EncodedImage:
    """A JPEG or PNG inside a larger file, decoded when asked for.

    Args:
        span: where its bytes are.
        name: of the image, for messages.
    """

    span: FileSpan
    name: str

    def __str__(self) -> str:
        return f"{self.span.path}: {self.name}"

    def load(self, reduction: int = 1) -> UInt8[np.ndarray, "h w 3"]:
        """The RGB image, ``reduction`` times smaller.

        Raises:
            FileNotFoundError: the file is gone.
            ValueError: the file was changed, or the image is truncated or none.
        """
        return decode_image(np.frombuffer(self.span.read(), dtype=np.uint8), str(self), reduction)
