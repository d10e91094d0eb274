"""Houses along the streets: blocks and gabled houses whose windows are drawn by the shader from a table of walls."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from coin3d.town.layout import Layout, Road
from coin3d.town.mesh import Material, Mesh, box, quad
from coin3d.town.plan import GroundPlan
from coin3d.town.terrain import Terrain


@dataclass(frozen=True)
class Wall:
    """A facade: a vertical rectangle with rows of windows.

    Args:
        start: (x, y) of its left end seen from outside.
        direction: (x, y) unit vector along it.
        base_z: height of its foot above z = 0.
        floor_m: height of a storey.
        bay_m: distance between windows.
        window: width and height of a window as fractions of bay and storey.
        shop: width fraction of the ground floor windows, 0 for an ordinary ground floor.
        colour: reflectance of the wall.
        trim: reflectance of sills, base and cornice.
        seed: makes window brightness differ between walls.
    """

    start: tuple[float, float]
    direction: tuple[float, float]
    base_z: float
    floor_m: float
    bay_m: float
    window: tuple[float, float]
    shop: float
    colour: Float[np.ndarray, "3"]
    trim: Float[np.ndarray, "3"]
    seed: float

    def row(self) -> list[float]:
        """The columns the shader reads."""
        return [
            *self.start,
            *self.direction,
            self.base_z,
            self.floor_m,
            self.bay_m,
            *self.window,
            self.shop,
            *self.trim,
            self.seed,
        ]


@dataclass
class Buildings:
    """What has been built: meshes, their walls, and the ground they stand on (grown while building)."""

    meshes: list[Mesh] = field(default_factory=list)
    walls: list[Wall] = field(default_factory=list)
    footprints: list[Float[np.ndarray, "4 2"]] = field(default_factory=list)

    def wall_table(self) -> Float[np.ndarray, "w 14"]:
        return np.array([w.row() for w in self.walls], dtype=np.float32).reshape(-1, 14)

    def overlaps(self, corners: Float[np.ndarray, "4 2"]) -> bool:
        """Separating axes against every footprint near by."""
        centre = corners.mean(0)
        near = (other for other in self.footprints if np.abs(other.mean(0) - centre).max() < 60)
        return any(not _separated(corners, other) for other in near)


@dataclass(frozen=True, eq=False)
class District:
    """What a quarter looks like."""

    storeys: tuple[int, int]
    width_m: tuple[float, float]
    depth_m: tuple[float, float]
    setback_m: tuple[float, float]
    gap_m: tuple[float, float]
    skip: float
    gable: float
    shops: float
    window: tuple[tuple[float, float], tuple[float, float]]


CITY = District((3, 9), (10.0, 26.0), (10.0, 16.0), (0.2, 0.8), (0.0, 0.6), 0.08, 0.1, 0.6, ((0.35, 0.65), (0.45, 0.65)))
SUBURB = District((1, 3), (8.0, 14.0), (8.0, 12.0), (3.0, 8.0), (3.0, 9.0), 0.15, 0.8, 0.05, ((0.25, 0.45), (0.40, 0.5)))
OFFICES = District((4, 14), (20.0, 40.0), (16.0, 26.0), (2.0, 8.0), (3.0, 14.0), 0.15, 0.0, 0.3, ((0.7, 0.92), (0.55, 0.75)))
WORKS = District((1, 3), (20.0, 45.0), (18.0, 30.0), (3.0, 10.0), (4.0, 16.0), 0.25, 0.25, 0.0, ((0.3, 0.8), (0.25, 0.4)))
DISTRICTS = (CITY, SUBURB, OFFICES, WORKS)


def build_buildings(layout: Layout, plan: GroundPlan, terrain: Terrain, rng: np.random.Generator) -> Buildings:
    """Rows of buildings on both sides of every road, wherever they touch neither road nor each other."""
    built = Buildings()
    district = DISTRICTS[int(rng.choice(4, p=[0.4, 0.25, 0.2, 0.15]))]
    palette = _palette(rng)
    for road in layout.roads:
        for side in (-1, 1):
            _row(built, road, side, district, palette, plan, terrain, rng)
    _skyline(built, layout, rng, palette)
    return built


def _row(
    built: Buildings,
    road: Road,
    side: int,
    district: District,
    palette: Float[np.ndarray, "p 3"],
    plan: GroundPlan,
    terrain: Terrain,
    rng: np.random.Generator,
) -> None:
    s = rng.uniform(0, 5)
    while s < road.centre.length_m - 6:
        width = rng.uniform(*district.width_m)
        depth = rng.uniform(*district.depth_m)
        edge = road.half_m(side) + road.pavement_m + rng.uniform(*district.setback_m)
        middle = s + width / 2
        s += width + rng.uniform(*district.gap_m)
        if rng.random() < district.skip:
            s += rng.uniform(4, 14)
            continue
        yaw = float(road.centre.yaw_at(middle, 4.0))
        along = np.array([np.cos(yaw), np.sin(yaw)])
        away = side * np.array([-along[1], along[0]])
        centre = road.centre.at(middle) + (edge + depth / 2) * away
        corners = centre + np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]]) * [width / 2, depth / 2] @ np.stack([along, away])
        if plan.covered(corners) or built.overlaps(corners):
            continue
        if side < 0:
            corners = corners[::-1]
        built.footprints.append(corners)
        storeys = int(rng.integers(district.storeys[0], district.storeys[1] + 1))
        _building(built, corners, storeys, district, palette, terrain, rng)


def _building(
    built: Buildings,
    corners: Float[np.ndarray, "4 2"],
    storeys: int,
    district: District,
    palette: Float[np.ndarray, "p 3"],
    terrain: Terrain,
    rng: np.random.Generator,
) -> None:
    """Walls around four corners (counter-clockwise), a base below the ground, and a roof."""
    floor = rng.uniform(2.8, 3.6)
    base = float(terrain.height_m(corners).min())
    height = storeys * floor + rng.uniform(0.3, 1.0) + float(terrain.height_m(corners).max()) - base
    colour = palette[rng.integers(len(palette))] * rng.uniform(0.85, 1.1)
    trim = np.clip(colour * rng.choice([0.5, 1.4]), 0.02, 0.85)
    window = (float(rng.uniform(*district.window[0])), float(rng.uniform(*district.window[1])))
    shop = float(rng.uniform(0.75, 0.92)) if rng.random() < district.shops else 0.0
    bay = rng.uniform(2.2, 4.2)
    z0, z1 = base - 0.5, base + height
    for i in range(4):
        a, b = corners[i], corners[(i + 1) % 4]
        run = float(np.linalg.norm(b - a))
        direction = (b - a) / run
        bays = max(1, round(run / bay))
        built.walls.append(
            Wall(
                (a[0], a[1]),
                (direction[0], direction[1]),
                base,
                floor,
                run / bays,
                window,
                shop,
                colour,
                trim,
                float(rng.random()),
            )
        )
        built.meshes.append(quad([(*a, z0), (*b, z0), (*b, z1), (*a, z1)], colour, Material.WALL, len(built.walls) - 1))
    roof = np.array([0.30, 0.10, 0.06]) if rng.random() < 0.5 else np.full(3, rng.uniform(0.06, 0.2))
    if rng.random() < district.gable:
        built.meshes += _gable(corners, z1, roof, colour, rng.uniform(0.5, 0.9))
    else:
        top = [(*c, z1) for c in corners]
        built.meshes.append(quad(top, roof))
        if rng.random() < 0.5:
            centre = corners.mean(0)
            built.meshes.append(box((centre[0], centre[1], z1 + 0.9), (3.0, 2.2, 1.8), np.full(3, rng.uniform(0.15, 0.5))))


def _gable(
    corners: Float[np.ndarray, "4 2"], z: float, roof: Float[np.ndarray, "3"], wall: Float[np.ndarray, "3"], pitch: float
) -> list[Mesh]:
    """A saddle roof along the longer side."""
    if np.linalg.norm(corners[1] - corners[0]) < np.linalg.norm(corners[2] - corners[1]):
        corners = np.roll(corners, -1, axis=0)
    a, b, c, d = corners
    rise = z + pitch * np.linalg.norm(c - b) / 2
    ridge_a, ridge_b = (*((a + d) / 2), rise), (*((b + c) / 2), rise)
    low = [(*p, z) for p in corners]
    ends = Mesh.create([low[1], low[2], ridge_b, low[3], low[0], ridge_a], [[0, 1, 2], [3, 4, 5]], wall)
    return [quad([low[0], low[1], ridge_b, ridge_a], roof), quad([low[2], low[3], ridge_a, ridge_b], roof), ends]


def _skyline(built: Buildings, layout: Layout, rng: np.random.Generator, palette: Float[np.ndarray, "p 3"]) -> None:
    """Distant blocks beyond the edge of the plan, so that streets do not end in nothing."""
    for angle in np.arange(0, 2 * np.pi, 0.14):
        reach = layout.half_extent_m * rng.uniform(1.25, 1.9)
        width, height = rng.uniform(18, 45), rng.uniform(6, 28)
        colour = palette[rng.integers(len(palette))] * 0.8
        block = box((0, 0, height / 2 - 4), (width, width * 0.7, height + 8), colour)
        built.meshes.append(block.moved((reach * np.cos(angle), reach * np.sin(angle), 0), angle + rng.uniform(-0.5, 0.5)))


def _palette(rng: np.random.Generator) -> Float[np.ndarray, "p 3"]:
    """Wall colours that go together: stone, plaster, brick and concrete in the mix of this town."""
    families = np.array(
        [
            [0.52, 0.46, 0.36],
            [0.62, 0.58, 0.50],
            [0.30, 0.12, 0.08],
            [0.38, 0.19, 0.12],
            [0.40, 0.40, 0.40],
            [0.66, 0.66, 0.64],
            [0.55, 0.42, 0.22],
            [0.28, 0.34, 0.40],
            [0.60, 0.38, 0.28],
            [0.22, 0.21, 0.20],
            [0.45, 0.50, 0.40],
        ]
    )
    chosen = families[rng.choice(len(families), size=5, replace=False)]
    return np.clip(chosen * rng.uniform(0.85, 1.15, (5, 3)), 0.03, 0.8)


def _separated(a: Float[np.ndarray, "4 2"], b: Float[np.ndarray, "4 2"]) -> bool:
    for polygon in (a, b):
        for i in range(2):
            axis = polygon[i + 1] - polygon[i]
            pa, pb = a @ axis, b @ axis
            if pa.max() <= pb.min() or pb.max() <= pa.min():
                return True
    return False
