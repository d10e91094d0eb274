"""Triangle meshes: validation, volume, closedness, files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from coin3d.geometry import Pose
from coin3d.geometry.mesh import TriangleMesh
from coin3d.geometry.mesh_file import load_mesh, save_mesh

TETRAHEDRON = TriangleMesh.create([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def test_volume_and_closedness_of_a_tetrahedron() -> None:
    assert TETRAHEDRON.volume_m3 == pytest.approx(1 / 6)
    assert TETRAHEDRON.is_watertight
    inside_out = TriangleMesh.create(TETRAHEDRON.vertices_m, TETRAHEDRON.faces[:, ::-1])
    assert inside_out.volume_m3 == pytest.approx(-1 / 6) and inside_out.is_watertight
    opened = TriangleMesh.create(TETRAHEDRON.vertices_m, TETRAHEDRON.faces[1:])
    assert not opened.is_watertight
    one_turned = np.concatenate([TETRAHEDRON.faces[:1, ::-1], TETRAHEDRON.faces[1:]])
    assert not TriangleMesh.create(TETRAHEDRON.vertices_m, one_turned).is_watertight
    assert not TriangleMesh.empty().is_watertight and TriangleMesh.empty().volume_m3 == 0


def test_volume_survives_world_coordinates() -> None:
    far = TETRAHEDRON.transformed(Pose.from_euler(1.0, 0.2, 0.1, [2000.0, -1500.0, 30.0]))
    assert far.volume_m3 == pytest.approx(1 / 6, rel=1e-3)


def test_concatenated_meshes_keep_their_own_vertices() -> None:
    shifted = TETRAHEDRON.transformed(Pose(np.eye(3), np.array([5.0, 0, 0])))
    both = TriangleMesh.concatenate([TETRAHEDRON, TriangleMesh.empty(), shifted])
    np.testing.assert_array_equal(both.corners_m()[4:], shifted.corners_m())
    assert both.is_watertight and both.volume_m3 == pytest.approx(2 / 6)
    assert len(TriangleMesh.concatenate([]).faces) == 0


def test_loose_vertices_go() -> None:
    part = TriangleMesh.create(TETRAHEDRON.vertices_m, TETRAHEDRON.faces[1:2]).without_loose_vertices()
    assert len(part.vertices_m) == 3
    np.testing.assert_array_equal(part.corners_m(), TETRAHEDRON.corners_m()[1:2])


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        ([[0, 0, np.nan], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], "vertex 0 .* not finite"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 3]], "face 0 names the vertices"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, -1]], "face 0 names the vertices"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 1, 1]], "face 1 names a vertex twice"),
    ],
)
def test_impossible_meshes_are_refused(vertices: list[list[float]], faces: list[list[int]], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        TriangleMesh.create(vertices, faces)


def test_ply_comes_back_and_other_programs_read_it(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "mesh.ply"
    save_mesh(path, TETRAHEDRON)
    again = load_mesh(path)
    np.testing.assert_array_equal(again.vertices_m, TETRAHEDRON.vertices_m)
    np.testing.assert_array_equal(again.faces, TETRAHEDRON.faces)
    other = trimesh.load_mesh(path, process=False)
    np.testing.assert_array_equal(other.faces, TETRAHEDRON.faces)
    assert other.volume == pytest.approx(1 / 6)
    save_mesh(path, TriangleMesh.empty())
    assert len(load_mesh(path).vertices_m) == 0
    assert [p.name for p in path.parent.iterdir()] == ["mesh.ply"]


def test_damaged_ply_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mesh.ply"
    with pytest.raises(FileNotFoundError, match="mesh is missing"):
        load_mesh(path)
    save_mesh(path, TETRAHEDRON)
    whole = path.read_bytes()
    for content, message in (
        (whole[:-3], "truncated"),
        (b"hello", "not a binary"),
        (whole.replace(b"float z", b"float q"), "other properties"),
        (whole.replace(b"binary_little_endian", b"ascii"), "not a binary"),
    ):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=message):
            load_mesh(path)
