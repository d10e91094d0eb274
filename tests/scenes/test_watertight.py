"""Closed objects against bodies that are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial import ConvexHull, cKDTree
from town_sweeps import TownSweeps, body_volume_m3, drive, sampled

from coin3d.geometry.mesh import TriangleMesh
from coin3d.scenes.meshes import SceneMeshes, build_meshes
from coin3d.scenes.ray_cloud import RayCloud
from coin3d.scenes.split import SplitScene, split_scene
from coin3d.scenes.tracks import instance_names
from coin3d.scenes.watertight import MIN_POINTS, close_object
from coin3d.town import TownOptions, World, build_world

SIZE_M = np.array([4.4, 1.8, 1.5])
# body and cabin of a simple car: low and high corners in the box frame
PARTS = (np.array([[-2.2, -0.9, -0.55], [2.2, 0.9, 0.05]]), np.array([[-1.6, -0.8, 0.05], [0.4, 0.8, 0.75]]))


def car_rays(sensors: list[tuple[float, float, float]], seed: int = 0, count: int = 12_000) -> RayCloud:
    """Points on the sides of the parts that face a sensor and are not inside the other part, with the mirrored copy."""
    rng = np.random.default_rng(seed)
    clouds = []
    for sensor in sensors:
        for low, high in PARTS:
            points = rng.uniform(low, high, (count, 3))
            axis, side = rng.integers(0, 3, count), rng.integers(0, 2, count)
            points[np.arange(count), axis] = np.where(side == 1, high[axis], low[axis])
            facing = np.where(side == 1, np.asarray(sensor)[axis] > high[axis], np.asarray(sensor)[axis] < low[axis])
            covered = np.zeros(count, dtype=bool)
            for other_low, other_high in PARTS:
                covered |= ((points > other_low) & (points < other_high)).all(1)
            covered |= (np.abs(points[:, 2] - 0.05) < 1e-9) & (points[:, 0] > -1.6) & (points[:, 0] < 0.4)
            clouds.append(RayCloud.from_origin(points[facing & ~covered], np.asarray(sensor)))
    rays = RayCloud.concatenate(clouds)
    return RayCloud.concatenate([rays, rays.mirrored()])


def share_within(points_m: np.ndarray, mesh: TriangleMesh, reach_m: float) -> float:
    distance = cKDTree(sampled(mesh.vertices_m, mesh.faces, 0.03)).query(points_m)[0]
    return float((distance < reach_m).mean())


@pytest.mark.parametrize(
    "sensors",
    [
        [(12.0, 5.0, 1.0), (-3.0, 7.0, 1.0)],
        [(1.0, 7.0, 1.0)],
        [(-10.0, 2.0, 1.0)],
    ],
    ids=["front, side and roof", "one side", "followed from behind"],
)
def test_a_car_is_closed_and_neither_hollow_nor_its_convex_hull(sensors: list[tuple[float, float, float]]) -> None:
    rays = car_rays(sensors)
    mesh = close_object(rays, SIZE_M)
    true_m3 = sum(float(np.prod(high - low)) for low, high in PARTS)
    assert mesh.is_watertight
    assert share_within(rays.points_m[::7], mesh, 0.1) >= 0.95
    assert mesh.volume_m3 == pytest.approx(true_m3, rel=0.25)
    corners = np.concatenate([np.stack(np.meshgrid(*p.T), -1).reshape(-1, 3) for p in PARTS])
    assert mesh.volume_m3 < 0.98 * ConvexHull(corners).volume


def test_the_space_above_the_hood_stays_free() -> None:
    mesh = close_object(car_rays([(12.0, 5.0, 1.0), (-3.0, 7.0, 1.0)]), SIZE_M)
    over_hood = (mesh.vertices_m[:, 0] > 0.65) & (mesh.vertices_m[:, 2] > 0.25)
    assert not over_hood.any()


def test_points_that_enclose_nothing_but_themselves_still_give_something_closed() -> None:
    wall = np.column_stack([np.full(400, 0.3), np.random.default_rng(0).uniform(-0.2, 0.2, (400, 2))])
    mesh = close_object(RayCloud.from_origin(wall, np.array([10.0, 0, 0])), np.array([0.7, 0.6, 0.6]))
    assert mesh.is_watertight
    assert len(close_object(RayCloud.concatenate([]), SIZE_M).faces) == 0


@dataclass(frozen=True)
class Scene:
    """A drive, who was seen how, and the meshes."""

    world: World
    sweeps: TownSweeps
    split: SplitScene
    meshes: SceneMeshes


@pytest.fixture(scope="module")
def town() -> Scene:
    world = build_world(3, TownOptions(traffic=0.5, people=0.1, duration_s=3.0))
    sweeps = drive(world, key_frames=4)
    return Scene(world, sweeps, split_scene(sweeps.frames, sweeps.sweeps), build_meshes(sweeps.frames, sweeps.sweeps))


def test_well_observed_vehicles_of_the_town_have_the_volume_of_their_bodies(town: Scene) -> None:
    bodies = {a.name: a for a in town.world.actors}
    ratios, shares = [], []
    for name, seen in town.split.objects.items():
        actor = bodies[name]
        if seen.num_points < 1000 or actor.category not in ("vehicle.car", "vehicle.truck", "vehicle.bus.rigid"):
            continue
        found = town.meshes.objects[name]
        assert found.mesh is not None and found.watertight and found.reason == ""
        ratios.append(found.mesh.volume_m3 / body_volume_m3(actor.postures[0]))
        shares.append(share_within(seen.rays.points_m[: seen.num_points], found.mesh, 0.1))
    assert len(ratios) >= 3
    assert np.abs(np.array(ratios) - 1).max() <= 0.25
    assert np.median(shares) >= 0.95 and min(shares) >= 0.9


def test_the_road_of_the_town_is_flat(town: Scene) -> None:
    assert town.meshes.num_sweeps == 16 and town.meshes.settings.spread == 2
    surface = town.meshes.background.vertices_m
    near = np.linalg.norm(surface[:, :2] - town.world.world_from_ego(0.7).translation[:2], axis=1) < 12
    road = near & (surface[:, 2] < 0.1)
    assert road.sum() > 5000
    assert np.median(np.abs(surface[road, 2])) < 0.02


def test_every_instance_is_accounted_for(town: Scene) -> None:
    assert list(town.split.objects) == list(town.meshes.objects)
    few = [o for o in town.meshes.objects.values() if o.num_points < MIN_POINTS]
    assert few and all(o.mesh is None and not o.watertight and "points" in o.reason for o in few)
    assert all(set(instance_names(f)) <= set(town.meshes.objects) for f in town.sweeps.frames)


def test_another_repair_can_be_plugged_in(town: Scene) -> None:
    calls: list[int] = []

    def hull(mesh: TriangleMesh, points_m: np.ndarray) -> TriangleMesh:
        assert len(mesh.faces) and not mesh.is_watertight
        calls.append(len(points_m))
        return TriangleMesh.create(points_m, ConvexHull(points_m).simplices)

    meshes = build_meshes(town.sweeps.frames[:1], repair=hull)
    done = [o for o in meshes.objects.values() if o.mesh is not None]
    assert len(calls) == len(done) > 0
