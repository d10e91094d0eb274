"""Files that announce or unpack to more than any memory are refused before memory is taken: a process with little proves it."""

from __future__ import annotations

import json
import os
import resource
import struct
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

SPARE_BYTES = 300 * 2**20
"""What the process may take beyond what its libraries do; the longest line of frames.jsonl is held and parsed in it."""


def _header(shape: str) -> bytes:
    text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".encode()
    text += b" " * (-(len(text) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text


def write_absurd(root: Path) -> None:
    """One file per kind, small on disk (some are holes)."""
    (root / "huge.npy").write_bytes(_header("(1099511627776, 4)") + bytes(64))
    for name, header, data in (("huge.npz", "(1099511627776, 4)", bytes(64)), ("bomb.npz", f"({2**26}, 1)", bytes(2**20))):
        with (
            zipfile.ZipFile(root / name, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
            archive.open("data.npy", "w") as file,
        ):
            file.write(_header(header))
            for _ in range(260 if name == "bomb.npz" else 1):
                file.write(data)
    fields = "FIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\n"
    (root / "binary.pcd").write_text(fields + "POINTS 999999999999\nDATA binary\n")
    (root / "ascii.pcd").write_text(fields + "POINTS 999999999999\nDATA ascii\n1 2 3\n")
    packed = struct.pack("<II", 16, 24 * 170_000_000) + bytes(16)
    (root / "packed.pcd").write_bytes((fields + "POINTS 170000000\nDATA binary_compressed\n").encode() + packed)
    (root / "mesh.ply").write_bytes(
        b"ply\nformat binary_little_endian 1.0\nelement vertex 999999999999\nproperty float x\nproperty float y\n"
        b"property float z\nelement face 999999999999\nproperty list uchar int vertex_indices\nend_header\n"
    )
    empty = {"dtype": "U8", "shape": [2**40, 0], "data_offsets": [0, 0]}
    names = ("rgb", "std", "exact", "corner_m", "step_m", "std_range_m", "centre", "exact_centre_m")
    tensors: dict[str, Any] = {"__metadata__": {"coin3d": "gaussians-1"}, **dict.fromkeys(names, empty)}
    text = json.dumps(tensors).encode()
    (root / "gaussians.safetensors").write_bytes(struct.pack("<Q", len(text)) + text)
    (root / "checkpoint.safetensors").write_bytes(struct.pack("<Q", 2**40) + bytes(64))
    merges = ["l0: &l0 {k: 0}", *(f"l{i}: &l{i} {{<<: [{', '.join([f'*l{i - 1}'] * 20)}]}}" for i in range(1, 12))]
    (root / "merges.yaml").write_text("\n".join(merges))
    aliases = ["l0: &l0 [x]", *(f"l{i}: &l{i} [{', '.join([f'*l{i - 1}'] * 20)}]" for i in range(1, 12))]
    (root / "aliases.yaml").write_text("\n".join([*aliases, "name: *l11", "cameras: {a: {size: *l11}}"]))
    (root / "deep.json").write_text('{"results": {"a": ' + "[" * 10**6)
    for name, size in (("rig.yaml", 2**34), ("scenes.txt", 2**34), ("own/frames.jsonl", 2**30), ("dgp/scene_1.json", 2**30)):
        (root / name).parent.mkdir(exist_ok=True)
        with (root / name).open("wb") as file:
            file.truncate(size)
    (root / "dgp" / "calibration").mkdir()


def readers(root: Path) -> dict[str, Callable[[], object]]:
    """What reads each of them."""
    from coin3d.datasets.classes import THREE_CLASS
    from coin3d.datasets.dgp import DgpRecording
    from coin3d.datasets.dgp_files import PointCloudFile
    from coin3d.datasets.own_recording import OwnRecording
    from coin3d.datasets.point_file import PointFile
    from coin3d.datasets.splits import read_names
    from coin3d.evaluation.results_json import read_results
    from coin3d.geometry import Pose, load_rig
    from coin3d.geometry.mesh_file import load_mesh
    from coin3d.rendering.gaussian_file import load_gaussians
    from coin3d.rig_import import Base, import_rig
    from coin3d.training.checkpoint import load_checkpoint

    here, xyz = Pose.identity(), ("x", "y", "z")
    found: dict[str, Callable[[], object]] = {
        "huge.npy": PointFile(root / "huge.npy", here, (*xyz, "intensity")).load,
        "mesh.ply": lambda: load_mesh(root / "mesh.ply"),
        "gaussians.safetensors": lambda: load_gaussians(root / "gaussians.safetensors"),
        "checkpoint.safetensors": lambda: load_checkpoint(root / "checkpoint.safetensors"),
        "deep.json": lambda: read_results(root / "deep.json", {"a": here}, THREE_CLASS),
        "scenes.txt": lambda: read_names(root / "scenes.txt"),
        "frames.jsonl": lambda: OwnRecording(root / "own"),
        "scene_1.json": lambda: DgpRecording(root / "dgp"),
    }
    for name in ("huge.npz", "bomb.npz"):
        found[name] = PointCloudFile(root / name, xyz, here, np.zeros(3)).load
    for name in ("binary.pcd", "ascii.pcd", "packed.pcd"):
        found[name] = PointFile(root / name, here).load
    for name in ("merges.yaml", "aliases.yaml", "rig.yaml"):
        found[name] = lambda name=name: load_rig(root / name)
        found[f"{name} to import"] = lambda name=name: import_rig(root / name, Base(), format="ros")
    return found


def read_in_little_memory(root: Path) -> None:
    """One line per file: what came of it."""
    cases = readers(root)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * os.sysconf("SC_PAGE_SIZE") + SPARE_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    for name, read in cases.items():
        try:
            read()
        except Exception as error:
            print(f"{name}\t{type(error).__name__}\t{str(error)[:300]}".replace("\n", " "))
        else:
            print(f"{name}\tnothing")


def test_absurd_sizes_are_refused_in_little_memory(tmp_path: Path) -> None:
    write_absurd(tmp_path)
    here = Path(__file__)
    module = f"import sys; sys.path.insert(0, {str(here.parent)!r}); import {here.stem} as tests"
    program = f"{module}; tests.read_in_little_memory(tests.Path({str(tmp_path)!r}))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    lines = [line.split("\t") for line in done.stdout.splitlines()]
    assert len(lines) == len(readers(tmp_path))
    for name, *said in lines:
        assert said[0] == "ValueError", f"{name}: {said}"
        assert name.split()[0] in said[1], f"{name}: {said}"
