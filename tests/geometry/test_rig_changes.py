"""The settings of the paper's supplement: rings that overlap, rigs that are raised."""

from __future__ import annotations

import numpy as np
import pytest

from coin3d.geometry import GroundPlane, Rig, preset_rig
from coin3d.geometry.rig_changes import full_overlap, raised


def test_every_direction_is_seen_twice_under_full_overlap() -> None:
    ring = full_overlap(preset_rig("nuscenes", 400))
    assert len(ring) == 6
    angle = np.deg2rad(np.arange(0.5, 360, 1.0))
    place = next(iter(ring.values())).ego_from_cam.translation
    around = place + 30 * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    assert (sum(camera.sees(around).astype(int) for camera in ring.values()) == 2).all()
    for i, camera in enumerate(ring.values()):
        assert np.rad2deg(camera.fov_horizontal_rad) == pytest.approx(120)
        assert np.rad2deg(camera.yaw_rad) % 360 == pytest.approx(60 * i)


def test_raised_goes_along_the_ground_normal_and_turns_nothing() -> None:
    level = preset_rig("waymo", 400)
    slope = GroundPlane((0.1, 0.0, np.sqrt(0.99)), 0.2)
    for ground in (level.ground, slope):
        rig = Rig(level.cameras, ground)
        for name, camera in raised(rig, 1.0).items():
            assert ground.height_m(camera.ego_from_cam.translation) == pytest.approx(
                ground.height_m(rig[name].ego_from_cam.translation) + 1.0
            )
            np.testing.assert_array_equal(camera.ego_from_cam.rotation, rig[name].ego_from_cam.rotation)
            np.testing.assert_array_equal(camera.K, rig[name].K)


def test_a_rig_under_the_road_and_a_ring_with_gaps_in_its_circle_are_refused() -> None:
    rig = preset_rig("nuscenes", 400)
    with pytest.raises(ValueError, match="below the ground"):
        raised(rig, -3.0)
    with pytest.raises(ValueError, match="divides 360"):
        full_overlap(rig, spacing_deg=50.0)
    with pytest.raises(ValueError, match="field of view"):
        full_overlap(rig, fov_deg=180.0)
