"""The ground plane found in synthetic sweeps."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from coin3d.datasets.ground_fit import fit_ground
from coin3d.geometry import GroundPlane

SENSOR = np.array([0.5, 0.0, 1.8])


def _sweep(plane: GroundPlane, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-20, 20, (4000, 2))
    z = -(xy @ plane.normal[:2] + plane.offset_m) / plane.normal[2] + rng.normal(0, 0.02, len(xy))
    wall = np.stack([np.full(3000, 8.0), rng.uniform(-20, 20, 3000), rng.uniform(0.5, 6, 3000)], axis=-1)
    kerb = np.stack([rng.uniform(-20, -9, 600), rng.uniform(-20, 20, 600), np.full(600, 0.35)], axis=-1)
    return np.concatenate([np.column_stack([xy, z]), wall, kerb])


@settings(max_examples=15, deadline=None)
@given(st.floats(-0.08, 0.08), st.floats(-0.08, 0.08), st.floats(-1.0, 1.0), st.integers(0, 100))
def test_finds_tilted_planes_between_walls_and_kerbs(slope_x: float, slope_y: float, height_m: float, seed: int) -> None:
    truth = GroundPlane(np.array([-slope_x, -slope_y, 1.0]), -height_m)
    sensor = SENSOR + np.array([0, 0, height_m])
    fit = fit_ground(_sweep(truth, seed), sensor)
    assert fit is not None
    assert np.rad2deg(np.arccos(min(1.0, fit.plane.normal @ truth.normal))) < 0.3
    assert abs(fit.plane.height_m(np.array([0, 0, height_m]))) < 0.03


def test_a_ground_far_below_the_ego_origin() -> None:
    fit = fit_ground(_sweep(GroundPlane(offset_m=1.8), 0) * [1, 1, 1], np.zeros(3))
    assert fit is not None
    assert abs(fit.plane.offset_m - 1.8) < 0.02


def test_too_few_points_give_nothing() -> None:
    assert fit_ground(np.zeros((0, 3)), SENSOR) is None
    wall = np.stack([np.full(500, 8.0), np.linspace(-5, 5, 500), np.linspace(0.5, 6, 500)], axis=-1)
    assert fit_ground(wall, SENSOR) is None
