"""What stands beside the road: kerbs, lamps, traffic lights, trees, hedges, bins; and the ground itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from coin3d.town.buildings import Buildings
from coin3d.town.layout import Layout, Road
from coin3d.town.mesh import Material, Mesh, ball, box, cylinder
from coin3d.town.plan import GroundPlan
from coin3d.town.terrain import Terrain

KERB_M = 0.11


def ground_mesh(layout: Layout, terrain: Terrain) -> Mesh:
    """The ground as a grid; beyond the plan it runs on to the horizon."""
    half = layout.half_extent_m
    step = 12.0 if terrain.is_flat else 2.0
    inner = np.linspace(-half, half, int(2 * half / step) + 1)
    line = np.concatenate([[-900.0, -400.0], inner, [400.0, 900.0]])
    x, y = np.meshgrid(line, line, indexing="ij")
    xy = np.stack([x, y], axis=-1)
    z = terrain.height_m(np.clip(xy, -half - 60, half + 60))
    n = len(line)
    index = np.arange(n * n).reshape(n, n)
    a, b, c, d = index[:-1, :-1].ravel(), index[1:, :-1].ravel(), index[1:, 1:].ravel(), index[:-1, 1:].ravel()
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return Mesh.create(np.concatenate([xy, z[..., None]], axis=-1), faces, (0.2, 0.2, 0.2), Material.GROUND)


def kerb_mesh(plan: GroundPlan, terrain: Terrain, rng: np.random.Generator) -> Mesh:
    """A low stone along every edge of the carriageway."""
    shade = np.full(3, rng.uniform(0.3, 0.5))
    meshes = []
    for line in plan.kerbs():
        ahead = np.gradient(line, axis=0)
        ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-6)
        normal = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1) * 0.08
        z = terrain.height_m(line)[:, None]
        n = len(line)
        ring = [(line - normal, z - 0.05), (line - normal, z + KERB_M), (line + normal, z + KERB_M), (line + normal, z - 0.05)]
        vertices = np.concatenate([np.concatenate([xy, h], axis=1) for xy, h in ring])
        i = np.arange(n - 1)
        faces = []
        for k in range(3):
            a, b = k * n + i, (k + 1) * n + i
            faces += [np.stack([a, b, b + 1], 1), np.stack([a, b + 1, a + 1], 1)]
        meshes.append(Mesh.create(vertices, np.concatenate(faces), shade))
    return Mesh.merge(meshes)


def street_furniture(layout: Layout, plan: GroundPlan, built: Buildings, terrain: Terrain, rng: np.random.Generator) -> Mesh:
    """Everything upright beside the roads."""
    meshes: list[Mesh] = []
    green = (
        np.array([0.055, 0.11, 0.03]) * rng.uniform(0.7, 1.6) * np.array([rng.choice([1.0, 1.6, 2.2], p=[0.7, 0.2, 0.1]), 1, 1])
    )
    lamp_gap, tree_gap = rng.uniform(22, 38), rng.uniform(8, 28)
    for road in layout.roads:
        for side in (-1, 1):
            for s in np.arange(rng.uniform(3, 20), road.centre.length_m, lamp_gap):
                if road.clear_of_crossings(s, 1.0):
                    meshes.append(_standing(_lamp(rng), road, s, side, 0.5, terrain))
            for s in np.arange(rng.uniform(3, 20), road.centre.length_m, tree_gap):
                if rng.random() < 0.75 and road.clear_of_crossings(s, 3.0):
                    meshes.append(
                        _standing(_tree(rng, green, rng.uniform(4.5, 8)), road, s + rng.uniform(-1, 1), side, 0.9, terrain)
                    )
            for s in rng.uniform(0, road.centre.length_m, 8):
                if road.clear_of_crossings(s, 2.0):
                    meshes.append(_standing(_small_thing(rng), road, s, side, rng.uniform(0.35, 0.6), terrain))
        for at, reach in road.crossings_m:
            for sign in (-1, 1):
                s = at + sign * (reach + 0.3)
                if 3 < s < road.centre.length_m - 3:
                    meshes.append(_standing(_traffic_light(), road, s, -1 if sign < 0 else 1, 0.45, terrain))
    for x, y in rng.uniform(-layout.half_extent_m * 0.95, layout.half_extent_m * 0.95, (420, 2)):
        patch = np.array([[x + 2, y - 2], [x + 2, y + 2], [x - 2, y + 2], [x - 2, y - 2]])
        if not plan.covered(patch, 1.0) and not built.overlaps(patch):
            crown = _tree(rng, green, rng.uniform(4, 11)) if rng.random() < 0.7 else _bush(rng, green)
            meshes.append(crown.moved((x, y, float(terrain.height_m((x, y))))))
    return Mesh.merge(meshes)


def _standing(thing: Mesh, road: Road, s: float, side: int, from_kerb_m: float, terrain: Terrain) -> Mesh:
    """Set a thing on the pavement, its +x towards the road."""
    yaw = float(road.centre.yaw_at(s))
    away = side * np.array([-np.sin(yaw), np.cos(yaw)])
    xy = road.centre.at(s) + (road.half_m(side) + from_kerb_m) * away
    return thing.moved((*xy, float(terrain.height_m(xy))), float(np.arctan2(-away[1], -away[0])))


def _lamp(rng: np.random.Generator) -> Mesh:
    grey, height = np.full(3, 0.12), 7.0
    return Mesh.merge(
        [
            cylinder((0, 0, 0), (0, 0, height), 0.09, grey, 6, 0.06),
            cylinder((0, 0, height), (1.6, 0, height + 0.3), 0.045, grey, 5),
            box((1.8, 0, height + 0.3), (0.7, 0.26, 0.1), grey),
        ]
    )


def _traffic_light() -> Mesh:
    grey = np.full(3, 0.06)
    parts = [cylinder((0, 0, 0), (0, 0, 3.4), 0.07, grey, 6), box((0, 0, 3.0), (0.26, 0.28, 0.85), grey * 0.4)]
    for z, colour in ((3.28, (0.8, 0.04, 0.03)), (3.0, (0.25, 0.12, 0.02)), (2.72, (0.02, 0.2, 0.05))):
        parts.append(box((0, 0, z), (0.3, 0.17, 0.17), np.array(colour), Material.LAMP))
    return Mesh.merge(parts)


def _small_thing(rng: np.random.Generator) -> Mesh:
    kind = rng.integers(4)
    if kind == 0:
        return cylinder((0, 0, 0), (0, 0, 0.95), 0.22, np.array([0.05, 0.12, 0.07]), 8)
    if kind == 1:
        return box((0, 0, 0.6), (0.45, 0.9, 1.2), np.array([0.25, 0.27, 0.26]))
    if kind == 2:
        return cylinder((0, 0, 0), (0, 0, 0.9), 0.06, np.array([0.5, 0.5, 0.48]), 6)
    face = box(
        (0.03, 0, 2.3), (0.03, 0.6, 0.6), np.array([[0.05, 0.12, 0.5], [0.6, 0.03, 0.03], [0.7, 0.7, 0.65]])[rng.integers(3)]
    )
    return Mesh.merge([cylinder((0, 0, 0), (0, 0, 2.6), 0.035, np.full(3, 0.3), 5), face])


def _tree(rng: np.random.Generator, green: Float[np.ndarray, "3"], height: float) -> Mesh:
    bark = np.array([0.11, 0.08, 0.055])
    trunk = height * rng.uniform(0.28, 0.4)
    parts = [cylinder((0, 0, -0.3), (0, 0, trunk + 0.6), 0.028 * height, bark, 7, 0.018 * height)]
    shade = green * rng.uniform(0.75, 1.3)
    spread = height * rng.uniform(0.22, 0.34)
    for _ in range(int(rng.integers(4, 7))):
        radius = spread * rng.uniform(0.55, 0.95)
        centre = np.append(rng.uniform(-0.55, 0.55, 2) * spread, rng.uniform(trunk + 0.45 * radius, height - radius))
        parts.append(
            ball(
                centre,
                (radius, radius, radius * rng.uniform(0.75, 1.0)),
                shade * rng.uniform(0.85, 1.15),
                Material.FOLIAGE,
                5,
                9,
                rng.uniform(0.84, 1.14, 64),
            )
        )
    return Mesh.merge(parts)


def _bush(rng: np.random.Generator, green: Float[np.ndarray, "3"]) -> Mesh:
    radius = rng.uniform(0.6, 1.4)
    return ball((0, 0, radius * 0.5), (radius, radius, radius * 0.8), green, Material.FOLIAGE, 4, 9, rng.uniform(0.8, 1.2, 64))


def draped(mesh: Mesh, terrain: Terrain) -> Mesh:
    """The mesh with every vertex lifted by the ground below it, so that bodies follow a slope."""
    if terrain.is_flat:
        return mesh
    vertices = mesh.vertices.copy()
    vertices[:, 2] += terrain.height_m(vertices[:, :2]).astype(np.float32)
    return replace(mesh, vertices=vertices)
