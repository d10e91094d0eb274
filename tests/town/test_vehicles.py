"""Bodies fill their boxes exactly and show which end is the front."""

from __future__ import annotations

import numpy as np
import pytest

from coin3d.town import car_shapes, catalogue
from coin3d.town.car_bodies import car_body
from coin3d.town.car_shapes import CarShape
from coin3d.town.mesh import Mesh
from coin3d.town.raycast import face_normals

SHAPES = {name: getattr(car_shapes, name) for name in ("HATCHBACK", "SEDAN", "ESTATE", "SUV", "PANEL_VAN", "MINIVAN", "PICKUP")}


def _body(shape: CarShape) -> tuple[Mesh, np.ndarray]:
    size = np.array([np.mean(shape.length_m), np.mean(shape.width_m), np.mean(shape.height_m)])
    return car_body(shape, size, np.array([0.5, 0.1, 0.1]), np.array([0.8, 0.8, 0.8])), size


def _roof_profile(mesh: Mesh, length_m: float) -> np.ndarray:
    """Height of the highest triangle above 41 places along the middle of the body, from rear to front."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    heights = []
    for x in np.linspace(-0.49, 0.49, 41) * length_m:
        p = np.array([x, 0.013])
        d = (b[:, 1] - c[:, 1]) * (a[:, 0] - c[:, 0]) + (c[:, 0] - b[:, 0]) * (a[:, 1] - c[:, 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            u = ((b[:, 1] - c[:, 1]) * (p[0] - c[:, 0]) + (c[:, 0] - b[:, 0]) * (p[1] - c[:, 1])) / d
            v = ((c[:, 1] - a[:, 1]) * (p[0] - c[:, 0]) + (a[:, 0] - c[:, 0]) * (p[1] - c[:, 1])) / d
            inside = (u >= 0) & (v >= 0) & (u + v <= 1)
            z = u * a[:, 2] + v * b[:, 2] + (1 - u - v) * c[:, 2]
        heights.append(z[inside].max())
    return np.array(heights)


@pytest.mark.parametrize("name", SHAPES)
def test_body_fills_its_box(name: str) -> None:
    mesh, size = _body(SHAPES[name])
    low, high = mesh.vertices.min(0), mesh.vertices.max(0)
    np.testing.assert_allclose(high - low, size, atol=1e-5)
    np.testing.assert_allclose(low, [-size[0] / 2, -size[1] / 2, 0], atol=1e-5)


@pytest.mark.parametrize("name", SHAPES)
def test_front_and_rear_silhouettes_differ(name: str) -> None:
    mesh, size = _body(SHAPES[name])
    profile = _roof_profile(mesh, size[0])
    difference = np.abs(profile - profile[::-1]) / size[2]
    assert difference.max() > 0.2
    assert (difference > 0.08).mean() > 0.15


@pytest.mark.parametrize("seed", range(4))
def test_every_road_user_keeps_within_its_box(seed: int) -> None:
    rng = np.random.default_rng(seed)
    makers = (
        catalogue.random_truck,
        catalogue.random_bus,
        catalogue.random_cyclist,
        catalogue.random_parked_bicycle,
        lambda r: catalogue.random_motorcycle(r, True),
        lambda r: catalogue.random_pedestrian(r, True),
        catalogue.random_car,
    )
    for make in makers:
        body = make(rng)
        for mesh in body.postures:
            low, high = mesh.vertices.min(0), mesh.vertices.max(0)
            half = body.size_m[:2] / 2 + 1e-4
            assert (np.abs(low[:2]) <= half).all() and (np.abs(high[:2]) <= half).all(), body.category
            assert low[2] >= -0.02 and high[2] <= body.size_m[2] + 0.03, body.category
            assert high[2] > 0.95 * body.size_m[2], body.category


def test_skin_faces_outwards() -> None:
    mesh, size = _body(car_shapes.SEDAN)
    normals = face_normals(mesh)
    centre = mesh.vertices[mesh.faces].mean(1)
    roof = centre[:, 2] > 0.9 * size[2]
    assert (normals[roof, 2] > 0).mean() > 0.95
