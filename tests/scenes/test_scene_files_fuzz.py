"""Damaged products of scenes: meshes, Gaussians, point models, indices."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from coin3d.geometry.mesh import TriangleMesh
from coin3d.geometry.mesh_file import load_mesh, save_mesh
from coin3d.rendering.gaussian_file import load_gaussians, save_gaussians
from coin3d.rendering.gaussian_folder import SCENES_FILE, GaussianFolder
from coin3d.rendering.gaussians import Gaussians
from coin3d.scenes.object_points import ObjectPoints
from coin3d.scenes.work_files import SceneFiles, read_meshes, read_models, write_models
from fuzzing import WRONG, damaged, refused

TIMES = 200
TETRAHEDRON = TriangleMesh.create([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def cloud(count: int) -> Gaussians:
    rng = np.random.default_rng(0)
    centre = rng.uniform(-9, 9, (count, 3)).astype(np.float32)
    return Gaussians(centre, rng.uniform(0.01, 0.1, count).astype(np.float32), rng.integers(0, 256, (count, 3), np.uint8))


# --- meshes ---


def test_meshes_cut_off_or_flipped(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    path = tmp_path / "a.ply"
    save_mesh(path, TETRAHEDRON)
    whole = path.read_bytes()
    for _ in range(2 * TIMES):
        path.write_bytes(damaged(whole, rng))
        mesh = refused(lambda: load_mesh(path), str(path))
        assert mesh is None or (mesh.vertices_m.shape == (4, 3) and mesh.faces.shape == (4, 3))


@pytest.mark.parametrize(
    ("vertices", "faces"),
    [
        ("-1", "4"),
        ("-13", "12"),
        ("4", "-4"),
        ("99999999999999999999", "4"),
        ("x", "4"),
        ("4 4", "4"),
        ("", "4"),
        ("1e3", "4"),
    ],
)
def test_counts_of_meshes_that_make_no_sense(tmp_path: Path, vertices: str, faces: str) -> None:
    path = tmp_path / "a.ply"
    save_mesh(path, TETRAHEDRON)
    content = path.read_bytes().replace(b"vertex 4", f"vertex {vertices}".encode()).replace(b"face 4", f"face {faces}".encode())
    path.write_bytes(content)
    assert refused(lambda: load_mesh(path), str(path)) is None


def test_the_index_of_the_meshes(tmp_path: Path) -> None:
    files = SceneFiles(tmp_path)
    save_mesh(files.meshes / "background.ply", TETRAHEDRON)
    save_mesh(files.meshes / "0000.ply", TETRAHEDRON)
    files.mesh_index.write_text(json.dumps({"objects": {"car": {"file": "0000.ply"}}}))
    assert list(read_meshes(files)[1]) == ["car"]
    texts = ["", "{}", "[]", "[" * 50_000, '{"objects": 3}', '{"objects": {"car": 3}}', '{"objects": {"car": {}}}']
    texts += [
        json.dumps({"objects": {"car": {"file": name}}}) for name in ("../0000.ply", "/etc/passwd", 7, ["0000.ply"], "none.ply")
    ]
    for text in texts:
        files.mesh_index.write_text(text)
        assert refused(lambda: read_meshes(files), str(tmp_path)) is None, text[:60]


# --- Gaussians ---


def test_gaussians_cut_off_or_flipped(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    path = tmp_path / "a.safetensors"
    save_gaussians(path, cloud(300))
    whole = path.read_bytes()
    for number in range(TIMES):
        # the header is small beside the numbers
        path.write_bytes(damaged(whole, rng) if number % 2 else damaged(whole[:900], rng) + whole[900:])
        found = refused(lambda: load_gaussians(path), str(path))
        assert found is None or (len(found) == 300 and np.isfinite(found.centre_m).all())


@pytest.mark.parametrize("name", ["rgb", "std", "exact", "corner_m", "step_m", "std_range_m", "centre", "exact_centre_m"])
@pytest.mark.parametrize("shape", [(0,), (2**40, 0), (0, 2**40), (), (3,), (300, 300), (1, 1, 1)])
def test_tables_of_other_shapes(tmp_path: Path, name: str, shape: tuple[int, ...]) -> None:
    path = tmp_path / "a.safetensors"
    save_gaussians(path, cloud(300))
    tensors = load_file(path)
    tensors[name] = np.zeros(shape, tensors[name].dtype)
    save_file(tensors, path, metadata={"coin3d": "gaussians-1"})
    assert refused(lambda: load_gaussians(path), str(path)) is None


def test_tables_that_are_huge_and_empty_at_once(tmp_path: Path) -> None:
    """Rows without columns take no bytes, and so may be as many as one likes."""
    path = tmp_path / "a.safetensors"
    save_gaussians(path, cloud(256))
    tensors = {name: np.zeros((2**40 if name in ("rgb", "std") else 2**32, 0), t.dtype) for name, t in load_file(path).items()}
    save_file(tensors, path, metadata={"coin3d": "gaussians-1"})
    assert refused(lambda: load_gaussians(path), str(path)) is None


def test_folders_of_gaussians(tmp_path: Path) -> None:
    save_gaussians(tmp_path / "street" / "0.safetensors", cloud(3))
    for text in ("", "[]", "3", "[" * 50_000, '{"raw_only": []}', '{"raw_only": 3}'):
        (tmp_path / SCENES_FILE).write_text(text)
        assert refused(lambda: GaussianFolder.open(tmp_path), SCENES_FILE) is None, text[:60]
    (tmp_path / SCENES_FILE).unlink()
    folder = GaussianFolder.open(tmp_path)
    assert folder.load("street", "0") is not None
    for scene, token in (("street", "../street/0"), ("../" + tmp_path.name + "/street", "0"), ("street/..", "street/0")):
        with pytest.raises(ValueError, match="is no name of a file"):
            folder.load(scene, token)


# --- point models ---


def test_point_models_cut_off_flipped_or_wrong(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    path = tmp_path / "objects.safetensors"
    model = ObjectPoints(np.zeros((5, 3), np.float32), np.zeros((5, 3), np.uint8), 0.1)
    write_models(path, {"car": model})
    whole = path.read_bytes()
    for _ in range(TIMES):
        path.write_bytes(damaged(whole, rng))
        refused(lambda: read_models(path), str(path))
    for wrong in (*WRONG, {"car": "x"}, {"car": None}, {"car": 0.1, "van": 0.1}):
        metadata: dict[str, Any] = {"spacing_m": json.dumps(wrong)}
        save_file({"0/points_m": model.points_m, "0/rgb": model.rgb}, path, metadata=metadata)
        found = refused(lambda: read_models(path), str(path))
        assert not found or list(found) == ["a"]
