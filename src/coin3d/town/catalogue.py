"""Random road users: which shape, how large, what colour."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from coin3d.town import car_shapes as cars
from coin3d.town.car_bodies import car_body
from coin3d.town.large_bodies import bus_body, truck_body
from coin3d.town.mesh import Mesh
from coin3d.town.people import cyclist, motorcycle, parked_bicycle, pedestrian

_PAINTS = np.array(
    [
        [0.75, 0.75, 0.74],
        [0.72, 0.72, 0.70],
        [0.45, 0.46, 0.47],
        [0.18, 0.19, 0.20],
        [0.08, 0.08, 0.09],
        [0.018, 0.018, 0.02],
        [0.03, 0.07, 0.25],
        [0.02, 0.03, 0.09],
        [0.45, 0.02, 0.02],
        [0.22, 0.015, 0.02],
        [0.03, 0.12, 0.06],
        [0.42, 0.36, 0.26],
        [0.10, 0.28, 0.45],
        [0.60, 0.22, 0.02],
        [0.65, 0.50, 0.04],
        [0.20, 0.13, 0.08],
    ]
)
_PAINT_SHARE = np.array([14, 8, 12, 12, 8, 12, 6, 6, 6, 3, 3, 3, 3, 2, 2, 2], dtype=np.float64) / 102
_SKINS = np.array([[0.55, 0.36, 0.27], [0.42, 0.26, 0.18], [0.20, 0.11, 0.07], [0.62, 0.44, 0.35]])
_HAIRS = np.array([[0.02, 0.015, 0.012], [0.08, 0.04, 0.02], [0.30, 0.20, 0.08], [0.4, 0.4, 0.4]])
_CARS = (cars.HATCHBACK, cars.SEDAN, cars.ESTATE, cars.SUV, cars.MINIVAN, cars.PANEL_VAN)
_CAR_SHARE = (0.26, 0.28, 0.12, 0.22, 0.07, 0.05)
_GAIT = (-1.0, -0.5, 0.0, 0.5, 1.0, 0.5, 0.0, -0.5)


@dataclass(frozen=True, eq=False)
class Body:
    """A road user without a place: category, (length, width, height), meshes per posture, half the axle distance."""

    category: str
    size_m: Float[np.ndarray, "3"]
    postures: tuple[Mesh, ...]
    half_base_m: float


def _paint(rng: np.random.Generator) -> Float[np.ndarray, "3"]:
    return np.asarray(np.clip(_PAINTS[rng.choice(len(_PAINTS), p=_PAINT_SHARE)] * rng.uniform(0.85, 1.1, 3), 0.01, 0.85))


def _cloth(rng: np.random.Generator) -> Float[np.ndarray, "3"]:
    return np.clip(rng.uniform(0.02, 0.5) * rng.uniform(0.4, 1.4, 3), 0.015, 0.7)


def _size(rng: np.random.Generator, shape: cars.CarShape) -> Float[np.ndarray, "3"]:
    # one draw for all three, so that long cars are wide and tall too
    t = rng.random()
    ranges = np.array([shape.length_m, shape.width_m, shape.height_m])
    return np.asarray(np.round(ranges[:, 0] + t * (ranges[:, 1] - ranges[:, 0]), 3))


def random_car(rng: np.random.Generator) -> Body:
    """A car; now and then a pick-up, which nuScenes counts among the trucks."""
    if rng.random() < 0.05:
        shape, category = cars.PICKUP, "vehicle.truck"
    else:
        shape, category = _CARS[int(rng.choice(len(_CARS), p=_CAR_SHARE))], "vehicle.car"
    size = _size(rng, shape)
    plate = np.array([0.8, 0.8, 0.78]) if rng.random() < 0.6 else np.array([0.75, 0.55, 0.05])
    body = car_body(shape, size, _paint(rng), plate)
    return Body(category, size, (body,), float(size[0] * (shape.axles[1] - shape.axles[0]) / 2))


def random_truck(rng: np.random.Generator) -> Body:
    size = np.round(np.array([rng.uniform(6.2, 9.6), rng.uniform(2.25, 2.5), rng.uniform(2.7, 3.5)]), 3)
    cargo = np.array([0.72, 0.72, 0.70]) * rng.uniform(0.7, 1.05) if rng.random() < 0.6 else _paint(rng)
    return Body("vehicle.truck", size, (truck_body(size, _paint(rng), cargo),), float(size[0] * 0.3))


def random_bus(rng: np.random.Generator) -> Body:
    size = np.round(np.array([rng.uniform(9.8, 12.0), rng.uniform(2.45, 2.55), rng.uniform(2.95, 3.25)]), 3)
    return Body("vehicle.bus.rigid", size, (bus_body(size, _paint(rng), _paint(rng)),), float(size[0] * 0.25))


def random_pedestrian(rng: np.random.Generator, walking: bool) -> Body:
    height = rng.uniform(1.52, 1.92)
    size = np.round(np.array([0.46 * height if walking else 0.26 * height, 0.36 * height, height]), 3)
    look = (_cloth(rng), _cloth(rng), _SKINS[rng.integers(4)], _HAIRS[rng.integers(4)])
    if not walking:
        return Body("human.pedestrian.adult", size, (pedestrian(size, 0.15, *look),), 0.2)
    postures = {swing: pedestrian(size, swing, *look) for swing in set(_GAIT)}
    return Body("human.pedestrian.adult", size, tuple(postures[swing] for swing in _GAIT), 0.2)


def random_cyclist(rng: np.random.Generator) -> Body:
    scale = rng.uniform(0.95, 1.05)
    size = np.round(np.array([1.75, 0.62, 1.82]) * scale, 3)
    mesh = cyclist(size, _paint(rng), _cloth(rng), _cloth(rng), _SKINS[rng.integers(4)], _paint(rng))
    return Body("vehicle.bicycle", size, (mesh,), 0.5)


def random_parked_bicycle(rng: np.random.Generator) -> Body:
    size = np.round(np.array([1.74, 0.56, 1.05]) * rng.uniform(0.96, 1.04), 3)
    return Body("vehicle.bicycle", size, (parked_bicycle(size, _paint(rng)),), 0.5)


def random_motorcycle(rng: np.random.Generator, ridden: bool) -> Body:
    size = np.round(np.array([2.1, 0.76, 1.62 if ridden else 1.3]) * rng.uniform(0.96, 1.05), 3)
    rider = (_cloth(rng), _cloth(rng), _SKINS[rng.integers(4)], _paint(rng)) if ridden else None
    return Body("vehicle.motorcycle", size, (motorcycle(size, _paint(rng), rider),), 0.65)


def random_moving(rng: np.random.Generator) -> Body:
    """Whoever drives in a lane."""
    kind = rng.choice(["car", "truck", "bus", "motorcycle", "bicycle"], p=[0.74, 0.08, 0.05, 0.07, 0.06])
    if kind == "car":
        return random_car(rng)
    if kind == "truck":
        return random_truck(rng)
    if kind == "bus":
        return random_bus(rng)
    return random_motorcycle(rng, True) if kind == "motorcycle" else random_cyclist(rng)
