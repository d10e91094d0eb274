"""Fusion and marching cubes against a float64 reference and against shapes whose surface is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coin3d.geometry.mesh import TriangleMesh
from coin3d.native import TsdfVolume, fill_holes, marching_cubes
from coin3d.scenes.fuse import Field, FusionSettings, fuse
from coin3d.scenes.ray_cloud import RayCloud
from coin3d.scenes.reference import fuse_reference

DENSE = FusionSettings(0.1, min_weight=1.0)


def sphere_cloud(radius_m: float, count: int, seed: int = 0, centre: tuple[float, float, float] = (0, 0, 0)) -> RayCloud:
    """A sphere seen from six places around it."""
    rng = np.random.default_rng(seed)
    unit = rng.standard_normal((count, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    origins = 10 * radius_m * np.concatenate([np.eye(3), -np.eye(3)])
    return RayCloud(radius_m * unit + centre, (unit @ origins.T).argmax(1), origins + centre)


def volume_values(points: np.ndarray, toward: np.ndarray, spread: int = 0, threads: int = 1, **kw: object) -> Field:
    volume = TsdfVolume(0.1, 0.3)
    volume.integrate(points, toward, spread=spread, threads=threads, **kw)
    coords, value = np.empty((volume.blocks, 3), np.int32), np.empty((volume.blocks, 8, 8, 8), np.float32)
    volume.field(coords, value, 0.0, threads)
    return Field(coords, value, 0.1)


def as_dict(field: Field) -> dict[tuple[int, int, int], float]:
    block, x, y, z = np.nonzero(~np.isnan(field.distance_m))
    voxels = field.coords[block] * 8 + np.stack([x, y, z], axis=1)
    return {tuple(map(int, v)): float(d) for v, d in zip(voxels, field.distance_m[block, x, y, z], strict=True)}


def random_rays(seed: int, count: int = 60) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    toward = rng.standard_normal((count, 3)).astype(np.float32)
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    return rng.uniform(-2, 2, (count, 3)), toward


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000), spread=st.integers(0, 2), offset_m=st.sampled_from([0.0, -1234.5, 80_000.0]))
def test_native_fusion_equals_the_reference(seed: int, spread: int, offset_m: float) -> None:
    points, toward = random_rays(seed)
    points = points + offset_m
    weight = np.random.default_rng(seed).uniform(0.1, 3, len(points)).astype(np.float32)
    native = as_dict(volume_values(points, toward, spread, weight=weight))
    plain = fuse_reference(points, toward, 0.1, 0.3, spread, weight)
    assert native.keys() == plain.keys()
    worst = max(abs(native[v] - plain[v][0]) for v in plain)
    assert worst < 1e-6


def test_min_weight_hides_voxels_seen_less() -> None:
    points = np.array([[0.05, 0.05, 0.06]] * 3 + [[5.05, 5.05, 0.05]])
    toward = np.tile(np.array([[0, 0, 1]], dtype=np.float32), (4, 1))
    volume = TsdfVolume(0.1, 0.3)
    volume.integrate(points, toward)
    coords, value = np.empty((volume.blocks, 3), np.int32), np.empty((volume.blocks, 8, 8, 8), np.float32)
    volume.field(coords, value, 3.0)
    seen = as_dict(Field(coords, value, 0.1))
    assert set(seen) == {(0, 0, k) for k in range(-2, 4)}
    np.testing.assert_allclose([seen[0, 0, k] for k in range(-2, 4)], np.arange(-2, 4) * 0.1 - 0.01, atol=1e-6)


def test_any_number_of_threads_gives_the_same_bytes() -> None:
    cloud = sphere_cloud(3.0, 40_000)
    one, three = (fuse(cloud, DENSE, threads) for threads in (1, 3))
    np.testing.assert_array_equal(one.coords, three.coords)
    np.testing.assert_array_equal(one.distance_m, three.distance_m)
    a, b = one.surface(1), one.surface(3)
    np.testing.assert_array_equal(a.vertices_m, b.vertices_m)
    np.testing.assert_array_equal(a.faces, b.faces)


def test_a_sphere_is_closed_and_has_its_volume() -> None:
    mesh = fuse(sphere_cloud(1.5, 60_000, centre=(3.3, -7.1, 0.4)), DENSE).surface()
    assert mesh.is_watertight
    assert mesh.volume_m3 == pytest.approx(4 / 3 * np.pi * 1.5**3, rel=0.02)
    radius = np.linalg.norm(mesh.vertices_m - np.array([3.3, -7.1, 0.4]), axis=1)
    assert np.abs(radius - 1.5).max() < 0.05


def test_vertices_are_shared_across_blocks() -> None:
    mesh = fuse(sphere_cloud(1.5, 60_000), DENSE).surface()
    assert np.abs(mesh.vertices_m).max() > 0.8  # more than one block
    assert len(np.unique(np.round(mesh.vertices_m, 6), axis=0)) == len(mesh.vertices_m)
    assert len(np.unique(mesh.faces)) == len(mesh.vertices_m)


@pytest.mark.parametrize("tilt", [0.0, 0.37, -0.8])
def test_a_plane_is_met_far_below_a_voxel(tilt: float) -> None:
    rng = np.random.default_rng(1)
    u, v = rng.uniform(-2, 2, (2, 40_000))
    normal = np.array([np.sin(tilt), 0, np.cos(tilt)])
    points = np.stack([u * np.cos(tilt), v, -u * np.sin(tilt)], axis=1) + 0.0437 * normal
    points += rng.normal(0, 0.01, (len(points), 1)) * normal
    mesh = fuse(RayCloud.from_origin(points, 8 * normal + [0, 3, 0]), DENSE).surface()
    inner = (np.abs(mesh.vertices_m) < 1.3).all(1)
    assert inner.sum() > 500
    assert np.abs(mesh.vertices_m[inner] @ normal - 0.0437).max() < 0.01


def test_triangles_face_the_sensor() -> None:
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.uniform(-2, 2, (20_000, 2)), np.zeros(20_000)])
    for height in (2.0, -2.0):
        corners = fuse(RayCloud.from_origin(points, np.array([0.3, 0.1, height])), DENSE).surface().corners_m()
        normal_z = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
        assert len(corners) > 100 and (np.sign(normal_z) == np.sign(height)).all()


@given(seed=st.integers(0, 10_000))
@settings(max_examples=20)
def test_any_field_has_a_closed_surface(seed: int) -> None:
    """Noise has every way to cross a cube, ambiguous faces too; with a free rim nothing may stay open."""
    value = np.random.default_rng(seed).standard_normal((16, 8, 8)).astype(np.float32)
    for axis in range(3):
        np.moveaxis(value, axis, 0)[[0, -1]] = 1.0
    blocks = np.stack([value[:8], value[8:]])
    vertices, faces = marching_cubes(np.array([[-1, 0, 0], [0, 0, 0]], dtype=np.int32), blocks, 0.1)
    mesh = TriangleMesh.create(vertices, faces)
    assert mesh.is_watertight and mesh.volume_m3 > 0


def test_cubes_with_an_unknown_corner_stay_open_and_fill_holes_closes_a_pinhole() -> None:
    z = (np.arange(8) - 3.3) * 0.1
    value = np.broadcast_to(z, (8, 8, 8)).astype(np.float32).copy()
    value[4, 4, :] = np.nan
    coords = np.zeros((1, 3), dtype=np.int32)
    _, faces = marching_cubes(coords, value[None], 0.1)
    assert len(faces) == 2 * (49 - 4)
    filled = np.empty_like(value)[None]
    fill_holes(coords, value[None], filled)
    np.testing.assert_allclose(filled[0, 4, 4, 1:7], z[1:7], atol=1e-6)
    assert len(marching_cubes(coords, filled, 0.1)[1]) == 2 * 49


def test_a_sweep_over_flat_ground_gives_flat_ground() -> None:
    """32 beams, the sensor driving on: median height under 1 cm, though rays graze, whatever the height of the ground."""
    rng = np.random.default_rng(3)
    elevation = np.deg2rad(np.linspace(-30, -4, 24))[:, None]
    azimuth = np.linspace(0, 2 * np.pi, 1084, endpoint=False)[None]
    clouds = []
    for step in range(8):
        sensor = np.array([0.7 * step, 0.0, 1.84 + 0.05])
        distance = 1.84 / np.sin(-elevation) + rng.normal(0, 0.015, (24, 1084))
        flat = np.cos(elevation)
        unit = [flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation) + 0 * azimuth]
        rays = np.stack(unit, axis=-1)
        clouds.append(RayCloud.from_origin((sensor + rays * distance[..., None]).reshape(-1, 3), sensor))
    mesh = fuse(RayCloud.concatenate(clouds), FusionSettings.for_sweeps(8)).surface()
    near = np.linalg.norm(mesh.vertices_m[:, :2] - [2.5, 0], axis=1) < 15
    assert near.sum() > 10_000
    assert np.median(np.abs(mesh.vertices_m[near, 2] - 0.05)) < 0.01


def test_a_street_stays_sparse() -> None:
    rng = np.random.default_rng(4)
    ground = np.column_stack([rng.uniform(-50, 50, (200_000, 2)) * [1, 0.3], np.zeros(200_000)])
    volume = TsdfVolume(0.1, 0.3)
    volume.integrate(ground, np.tile(np.array([[0, 0, 1]], dtype=np.float32), (len(ground), 1)))
    # 100 m x 30 m: at most two layers of blocks of 0.8 m, 4 KiB each; a dense grid 10 m high would take 240 MB
    assert volume.blocks <= 2 * 127 * 39
    assert volume.bytes < 42e6


@pytest.mark.parametrize(
    ("points", "toward", "message"),
    [
        ([[np.nan, 0, 0]], [[0, 0, 1]], "not finite"),
        ([[1e9, 0, 0]], [[0, 0, 1]], "8 million voxels"),
        ([[0.0, 0, 0]], [[0, 0, 2]], "length 1"),
    ],
)
def test_impossible_points_are_refused(points: list[list[float]], toward: list[list[float]], message: str) -> None:
    volume = TsdfVolume(0.1, 0.3)
    with pytest.raises(ValueError, match=message):
        volume.integrate(np.array(points, dtype=np.float64), np.array(toward, dtype=np.float32))
    assert volume.blocks == 0


def test_nothing_seen_gives_an_empty_mesh() -> None:
    assert len(fuse(RayCloud.concatenate([]), DENSE).surface().faces) == 0


def test_settings_follow_the_number_of_sweeps() -> None:
    many, middle, few = (FusionSettings.for_sweeps(n) for n in (400, 96, 1))
    assert (many.min_weight, many.truncation_voxels, many.spread) == (5.0, 3.0, 0)
    assert many.min_weight > middle.min_weight >= 1 > few.min_weight > 0
    assert many.spread < middle.spread < few.spread
    with pytest.raises(ValueError, match="truncation"):
        FusionSettings(truncation_voxels=40)
