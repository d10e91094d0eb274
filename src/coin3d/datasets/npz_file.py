"""One array out of an npz file, without trusting what the file says about its size."""

from __future__ import annotations

import struct
import tokenize
import zipfile
import zlib
from pathlib import Path

import numpy as np

_LARGEST_BYTES = 2**28
"""8 million points of four doubles; a sweep has less than a million."""

_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}

HEADER_ERRORS = (
    OSError, ValueError, EOFError, TypeError, SyntaxError, KeyError, AttributeError, OverflowError, MemoryError, RecursionError,
    tokenize.TokenError,
)  # fmt: skip
"""What NumPy's parser of array headers raises for damaged ones."""


def read_npz_array(path: Path, name: str) -> np.ndarray:
    """A numeric array of an npz file.

    The archive is compressed: a few kilobytes can stand for gigabytes, and the header of the array may announce any shape. Both
    are compared with each other and with a limit before memory is taken.

    Args:
        path: the file.
        name: of the array.

    Raises:
        ValueError: missing, truncated, damaged, too large, or not numbers; the message names the file.
    """
    if not path.is_file():
        raise ValueError(f"{path}: the point cloud is missing")
    try:
        with zipfile.ZipFile(path) as archive:
            entry = archive.getinfo(f"{name}.npy")
            if entry.file_size > _LARGEST_BYTES:
                raise ValueError(f"'{name}' takes {entry.file_size} bytes, more than {_LARGEST_BYTES}")
            with archive.open(entry) as file:
                version = np.lib.format.read_magic(file)
                if version not in _HEADERS:
                    raise ValueError(f"version {version} of the array format")
                shape, fortran, dtype = _HEADERS[version](file)
                # what Python's own arrays may not be: negative sides, or a product beyond any memory
                size = dtype.itemsize
                for side in shape:
                    if not 0 <= side <= _LARGEST_BYTES:
                        raise ValueError(f"an array of shape {shape}")
                    size *= side
                if dtype.kind not in "fiu" or size + file.tell() != entry.file_size:
                    raise ValueError(f"{dtype} with shape {shape} in {entry.file_size} bytes")
                content = file.read(size)
                if file.read(1) or len(content) != size:
                    raise ValueError(f"{len(content)} bytes for {dtype} with shape {shape}")
    # encrypted entries and unknown compressions are errors at runtime and not implemented
    except (*HEADER_ERRORS, RuntimeError, NotImplementedError, zipfile.BadZipFile, zlib.error, struct.error) as error:
        raise ValueError(f"{path}: not a complete npz file with an array '{name}' ({error}); copy it again") from error
    return np.frombuffer(content, dtype).reshape(shape, order="F" if fortran else "C")
