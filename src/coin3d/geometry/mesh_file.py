"""Triangle meshes as binary PLY."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from coin3d.geometry.mesh import TriangleMesh
from coin3d.records import write_bytes

_FACE_RECORD = np.dtype([("count", "u1"), ("corners", "<i4", (3,))])


def save_mesh(path: Path, mesh: TriangleMesh) -> None:
    """Write a binary PLY (float32 vertices), never half a file.

    Raises:
        OSError: the file cannot be written.
    """
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(mesh.vertices_m)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(mesh.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    records = np.empty(len(mesh.faces), dtype=_FACE_RECORD)
    records["count"], records["corners"] = 3, mesh.faces
    write_bytes(path, header.encode("ascii") + mesh.vertices_m.astype("<f4").tobytes() + records.tobytes())


def load_mesh(path: Path) -> TriangleMesh:
    """Read a PLY that ``save_mesh`` wrote.

    Raises:
        FileNotFoundError: no such file.
        ValueError: another kind of PLY, or a truncated one.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: the mesh is missing")
    content = path.read_bytes()
    header, end, body = content.partition(b"end_header\n")
    lines = header.decode("ascii", errors="replace").split("\n")
    elements = [line.split() for line in lines if line.startswith("element ")]
    counts = {words[1]: int(words[2]) for words in elements if len(words) == 3 and words[2].isdecimal() and len(words[2]) < 16}
    expected = ["float x", "float y", "float z", "list uchar int vertex_indices"]
    if not end or "format binary_little_endian 1.0" not in lines or set(counts) != {"vertex", "face"} or len(elements) != 2:
        raise ValueError(f"{path}: not a binary little-endian PLY with vertices and faces")
    if [line.removeprefix("property ") for line in lines if line.startswith("property")] != expected:
        raise ValueError(f"{path}: a PLY with other properties than {', '.join(expected)}; load it with a mesh library")
    size = 12 * counts["vertex"] + _FACE_RECORD.itemsize * counts["face"]
    if len(body) != size:
        raise ValueError(f"{path}: {len(body)} bytes after the header, expected {size}; the file is truncated, make it again")
    vertices = np.frombuffer(body, dtype="<f4", count=3 * counts["vertex"])
    faces = np.frombuffer(body, dtype=_FACE_RECORD, offset=12 * counts["vertex"])
    if (faces["count"] != 3).any():
        raise ValueError(f"{path}: has faces that are not triangles")
    try:
        return TriangleMesh.create(vertices, faces["corners"])
    except ValueError as error:
        raise ValueError(f"{path}: {error}; make it again") from error
