"""Two small worlds shared by the tests of the town, and a small rig."""

from __future__ import annotations

from dataclasses import replace

import pytest

from coin3d.geometry import Rig, preset_rig
from coin3d.town import Moment, TownOptions, Tracer, World, build_world


@pytest.fixture(scope="session")
def world() -> World:
    return build_world(3)


@pytest.fixture(scope="session")
def moment(world: World) -> Moment:
    return Tracer(world).at(2.0)


@pytest.fixture(scope="session")
def hilly() -> World:
    return build_world(4, TownOptions(slope=True, traffic=0.4, people=0.3))


@pytest.fixture(scope="session")
def rig() -> Rig:
    return preset_rig("nuscenes", width_px=200)


@pytest.fixture(scope="session")
def two_cameras() -> Rig:
    full = preset_rig("nuscenes", width_px=96)
    return replace(full, cameras={n: full[n] for n in ("CAM_FRONT", "CAM_BACK")}, name="pair")
