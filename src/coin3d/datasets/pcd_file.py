"""Point clouds in PCD format (Point Cloud Library), all three kinds: ascii, binary, binary_compressed."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from coin3d.datasets.lzf import lzf_decompress

_LONGEST_HEADER = 16384
_NUMBERS = {"F": {4, 8}, "I": {1, 2, 4, 8}, "U": {1, 2, 4, 8}}
_KINDS = ("ascii", "binary", "binary_compressed")


@dataclass(frozen=True)
class PcdHeader:
    """What the lines before the data say.

    Args:
        names: of the fields; a field of ``count`` numbers per point takes as many columns.
        types: numpy types of the fields.
        counts: numbers per point of each field.
        points: how many.
        data: ascii, binary or binary_compressed.
        length: bytes of the header.
    """

    names: tuple[str, ...]
    types: tuple[str, ...]
    counts: tuple[int, ...]
    points: int
    data: str
    length: int

    @property
    def bytes_per_point(self) -> int:
        return sum(np.dtype(kind).itemsize * count for kind, count in zip(self.types, self.counts, strict=True))


def read_pcd(path: Path) -> dict[str, Float[np.ndarray, "n"]]:
    """The fields of one number per point, by name in lower case. VIEWPOINT is not applied.

    Raises:
        ValueError: the file is missing, truncated, damaged, or of no known kind.
    """
    if not path.is_file():
        raise ValueError(f"{path}: the point cloud is missing")
    content = path.read_bytes()
    try:
        header = _header(content)
        body = content[header.length :]
        columns = _ascii(body, header) if header.data == "ascii" else _binary(body, header)
    except (ValueError, KeyError, struct.error) as error:
        raise ValueError(f"{path}: not a complete PCD file: {error}") from error
    names = [name.lower() for name in header.names]
    return {n: c for n, c, count in zip(names, columns, header.counts, strict=True) if count == 1 and n != "_"}


def _header(content: bytes) -> PcdHeader:
    said: dict[str, list[str]] = {}
    at = 0
    while "DATA" not in said:
        end = content.find(b"\n", at, _LONGEST_HEADER)
        if end < 0:
            raise ValueError("its header has no line DATA")
        line, at = content[at:end].decode("ascii").split("#")[0].split(), end + 1
        if line:
            said[line[0].upper()] = line[1:]
    if missing := [key for key in ("FIELDS", "SIZE", "TYPE", "POINTS") if not said.get(key)]:
        raise ValueError(f"its header has no line {', '.join(missing)}")
    names = said["FIELDS"]
    sizes, counts = ([int(word) for word in said.get(key, ["1"] * len(names))] for key in ("SIZE", "COUNT"))
    if not len(names) == len(sizes) == len(said["TYPE"]) == len(counts):
        raise ValueError("FIELDS, SIZE, TYPE and COUNT differ in length")
    for name, kind, size, count in zip(names, said["TYPE"], sizes, counts, strict=True):
        if size not in _NUMBERS.get(kind, ()) or not 1 <= count <= 4096:
            raise ValueError(f"field {name} is of TYPE {kind}, SIZE {size}, COUNT {count}")
    lower = [name.lower() for name in names if name != "_"]
    if len(set(lower)) < len(lower):
        raise ValueError(f"two fields have one name: {' '.join(names)}")
    points, data = int(said["POINTS"][0]), " ".join(said["DATA"])
    if points < 0 or data not in _KINDS:
        raise ValueError(f"POINTS {points}, DATA {data}; known are {', '.join(_KINDS)}")
    types = tuple(f"<{kind.lower()}{size}" for kind, size in zip(said["TYPE"], sizes, strict=True))
    return PcdHeader(tuple(names), types, tuple(counts), points, data, at)


def _ascii(body: bytes, header: PcdHeader) -> list[np.ndarray]:
    words = body.split()
    width = sum(header.counts)
    if len(words) != header.points * width:
        raise ValueError(f"{header.points} points of {width} numbers are announced, {len(words)} numbers are there")
    table = np.array([float(word) for word in words]).reshape(-1, width)
    starts = np.cumsum([0, *header.counts])[:-1]
    return [table[:, start] for start in starts]


def _binary(body: bytes, header: PcdHeader) -> list[np.ndarray]:
    """Binary data are point by point, compressed data field by field."""
    size = header.points * header.bytes_per_point
    if header.data == "binary_compressed":
        compressed, uncompressed = struct.unpack_from("<II", body)
        if uncompressed != size or len(body) < 8 + compressed:
            raise ValueError(f"{header.points} points need {size} bytes, {uncompressed} are announced")
        body = lzf_decompress(body[8 : 8 + compressed], size)
    if len(body) < size:
        raise ValueError(f"{header.points} points of {header.bytes_per_point} bytes are announced, {len(body)} bytes are there")
    parts: list[np.ndarray] = []
    if header.data == "binary_compressed":
        at = 0
        for kind, count in zip(header.types, header.counts, strict=True):
            block = np.frombuffer(body, kind, header.points * count, at).reshape(-1, count)
            parts.append(block[:, 0].astype(np.float64))
            at += block.nbytes
        return parts
    fields = [(f"f{i}", kind, (count,)) for i, (kind, count) in enumerate(zip(header.types, header.counts, strict=True))]
    table = np.frombuffer(body, np.dtype(fields), header.points)
    return [table[f"f{i}"][:, 0].astype(np.float64) for i in range(len(fields))]
