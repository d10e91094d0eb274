"""Rigs drawn at random: ranges reached and kept, named presets, changed arrays, one seed one rig."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coin3d.augmentation import ArrayChange, RigSampler
from coin3d.augmentation.sampler_picture import draw_sampler
from coin3d.geometry import Camera, GroundPlane, Rig, preset_rig
from coin3d.records import from_plain, to_plain
from small_world import ring_rig

LEVEL = RigSampler(tilt_deg=0.0)
RING_ONLY = ArrayChange(keep=1e-9, drop=0, add=0, ring=1)


def draws(sampler: RigSampler, rig: Rig, count: int, seed: int = 0) -> list[Rig]:
    rng = np.random.default_rng(seed)
    return [sampler.draw(rig, rng) for _ in range(count)]


def same(a: Rig, b: Rig) -> bool:
    return list(a) == list(b) and all(
        np.array_equal(a[n].K, b[n].K) and a[n].ego_from_cam.allclose(b[n].ego_from_cam, atol=0) for n in a
    )


def height_m(rig: Rig, camera: Camera) -> float:
    return float(rig.ground.height_m(camera.ego_from_cam.translation))


def test_paper_ranges_are_reached_and_kept() -> None:
    source = preset_rig("nuscenes", 704)
    numbers = []
    for rig in draws(LEVEL, source, 150):
        assert list(rig) == list(source)
        for name, camera in rig.items():
            before = source[name]
            moved = camera.ego_from_cam.translation - before.ego_from_cam.translation
            turn = np.angle(np.exp(1j * (camera.yaw_rad - before.yaw_rad)))
            numbers.append([camera.focal_px / before.focal_px, moved[0], moved[1], height_m(rig, camera), np.rad2deg(turn)])
            assert (camera.width_px, camera.height_px) == (before.width_px, before.height_px)
            assert camera.ego_from_cam.rotation[2, 2] == pytest.approx(0, abs=1e-9)  # roll and pitch of a camera stay
    low, high = np.array([0.7, -0.2, -0.2, 1.5, -20]), np.array([1.4, 0.2, 0.2, 2.2, 20])
    reached = np.array(numbers)
    assert (reached >= low - 1e-9).all() and (reached <= high + 1e-9).all()
    span = high - low
    assert (reached.min(0) < low + 0.02 * span).all() and (reached.max(0) > high - 0.02 * span).all()
    np.testing.assert_allclose((reached.mean(0) - low) / span, 0.5, atol=0.05)
    # each camera on its own
    assert np.abs(np.corrcoef(reached.reshape(-1, 6, 5)[:, :2, 3].T)[0, 1]) < 0.25


def test_the_whole_rig_leans_as_one() -> None:
    source = preset_rig("nuscenes", 704)
    still = RigSampler((1.0, 1.0), 0.0, (1.5, 1.5), 0.0, 2.0, False)
    level = replace(still, tilt_deg=0.0).draw(source, np.random.default_rng(0))
    tilts = []
    for rig in draws(still, source, 60):
        leans = [rig[n].ego_from_cam @ level[n].ego_from_cam.inverse() for n in rig]
        assert all(lean.allclose(leans[0]) for lean in leans)  # one rotation about the ego origin
        np.testing.assert_allclose(leans[0].translation, 0, atol=1e-12)
        roll, pitch = leans[0].rotation[2, 1], -leans[0].rotation[2, 0]
        tilts.append([np.rad2deg(roll), np.rad2deg(pitch)])
    assert np.abs(tilts).max() <= 2.0 and (np.abs(tilts).max(0) > 1.7).all()


def test_heights_are_above_the_rigs_own_ground() -> None:
    ground = GroundPlane(np.array([0.05, -0.03, 1.0]), 0.9)
    source = Rig(ring_rig(4).cameras, ground)
    for rig in draws(LEVEL, source, 20):
        assert rig.ground is ground
        for name, camera in rig.items():
            assert 1.5 <= height_m(rig, camera) <= 2.2
            # turned about the upright: what the axis does to the ground stays
            before, after = (c.ego_from_cam.rotation[:, 2] @ ground.normal for c in (source[name], camera))
            assert after == pytest.approx(before, abs=1e-9)


def test_the_principal_point_strays_no_farther_than_it_is() -> None:
    K = np.array([[300.0, 0, 230], [0, 300, 90], [0, 0, 1]])
    camera = replace(ring_rig(1)["eye0"], K=K, width_px=400, height_px=260)
    centres = np.array([r["eye"].K[:2, 2] for r in draws(RigSampler(), Rig({"eye": camera}), 300)])
    assert (np.abs(centres - (200, 130)) <= (30, 40)).all() and (np.ptp(centres, axis=0) > (57, 76)).all()
    kept = RigSampler(jitter_centre=False).draw(Rig({"eye": camera}), np.random.default_rng(0))
    assert kept["eye"].K[:2, 2].tolist() == [230, 90]


@settings(max_examples=30)
@given(st.integers(0, 10**6), st.integers(1, 7), st.booleans())
def test_a_rig_is_a_function_of_the_generator(seed: int, cameras: int, vary: bool) -> None:
    sampler = RigSampler(array=ArrayChange() if vary else None)
    one, two = (sampler.draw(ring_rig(cameras), np.random.default_rng(seed)) for _ in range(2))
    assert same(one, two)
    assert 1 <= len(one) <= 8
    assert all(1.3 < height_m(one, camera) < 2.4 for camera in one.values())


def test_target_aware_ranges_surround_the_rig_of_nuscenes() -> None:
    target = preset_rig("nuscenes", 704)
    for rig in draws(RigSampler.target_aware_lyft(), preset_rig("lyft1", 704), 40):
        for name, side in (("CAM_FRONT_LEFT", 1), ("CAM_FRONT_RIGHT", -1)):
            x, y, _ = rig[name].ego_from_cam.translation
            assert 1.15 < x < 1.65 and 0.2 < side * y < 0.6
            assert 43 < side * np.rad2deg(rig[name].yaw_rad) < 67
        assert abs(rig["CAM_BACK_LEFT"].yaw_rad - target["CAM_BACK_LEFT"].yaw_rad) < np.deg2rad(13)
        assert 350 <= rig["CAM_BACK"].focal_px <= 560 and 450 <= rig["CAM_FRONT"].focal_px <= 560


def test_the_sign_slip_of_the_released_waymo_ranges_is_corrected() -> None:
    level = replace(RigSampler.target_aware_waymo(), tilt_deg=0.0)
    wide = 0
    for width in (704, 1920):
        for rig in draws(level, preset_rig("waymo", width), 60):
            left, right = (rig[n].ego_from_cam.translation for n in ("SIDE_LEFT", "SIDE_RIGHT"))
            assert 0.5 <= left[0] <= 0.6 and 0.5 <= right[0] <= 0.6 and left[1] > 0 > right[1]
            assert 85 <= rig["SIDE_LEFT"].K[1, 2] * 704 / width <= 95
            assert 500 <= rig["SIDE_RIGHT"].focal_px * 704 / width <= 700
            wide += rig["FRONT"].focal_px * 704 / width < 500
    assert 5 <= wide <= 35  # a sixth of 120, less its part above 500


def test_what_cannot_be_drawn_is_refused() -> None:
    with pytest.raises(ValueError, match=r"are for the cameras FRONT, FRONT_LEFT.*but the rig 'nuscenes' has CAM_FRONT"):
        RigSampler.target_aware_waymo().draw(preset_rig("nuscenes"), np.random.default_rng(0))
    with pytest.raises(ValueError, match="cannot be used with array changes"):
        replace(RigSampler.target_aware_lyft(), array=ArrayChange())
    with pytest.raises(ValueError, match="0 < low <= high"):
        RigSampler(focal_ratio=(1.4, 0.7))
    with pytest.raises(ValueError, match="not negative"):
        RigSampler(yaw_deg=-1.0)
    with pytest.raises(ValueError, match="weights"):
        ArrayChange(keep=0.0)


@pytest.mark.parametrize("sampler", [RigSampler(), RigSampler.target_aware_waymo(), RigSampler(array=ArrayChange(ring=2.0))])
def test_samplers_are_plain_data(sampler: RigSampler) -> None:
    assert from_plain(RigSampler, to_plain(sampler)) == sampler


@pytest.mark.parametrize(("cameras", "draws"), [(6, 1000), (1, 250), (5, 250)])
def test_counts_of_one_to_eight_occur(cameras: int, draws: int) -> None:
    rng, change, source = np.random.default_rng(0), ArrayChange(), ring_rig(cameras)
    counts = Counter(len(change.draw(source, rng)[0]) for _ in range(draws))
    assert sorted(counts) == list(range(1, 9))
    assert min(counts.values()) > 0.015 * draws


def test_a_ring_sees_all_around_whatever_else_is_drawn() -> None:
    azimuth = np.deg2rad(np.arange(0, 360, 0.5))
    far = np.column_stack([300 * np.cos(azimuth), 300 * np.sin(azimuth), np.full(len(azimuth), 1.8)])
    source, counts = preset_rig("nuscenes", 704), set()
    for rig in draws(RigSampler(array=RING_ONLY), source, 60):
        assert rig.sees(far).all()
        counts.add(len(rig))
        assert len({round(c.focal_px, 6) for c in rig.values()}) == 1
    assert counts == {4, 5, 6, 7, 8}


def test_dropped_and_added_cameras() -> None:
    source, rng = ring_rig(5), np.random.default_rng(3)
    dropping, adding = ArrayChange(1e-9, 1, 0, 0), ArrayChange(1e-9, 0, 1, 0)
    for _ in range(20):
        fewer, _ = dropping.draw(source, rng)
        assert 1 <= len(fewer) < 5 and [n for n in source if n in fewer] == list(fewer)
        more, _ = adding.draw(source, rng)
        assert 5 < len(more) <= 8 and list(more)[:5] == list(source)
        extra = more["added0"].ego_from_cam
        outwards = extra.translation[:2] - np.mean([c.ego_from_cam.translation[:2] for c in source.values()], axis=0)
        assert extra.rotation[:2, 2] @ outwards > 0.99 * np.linalg.norm(outwards)
    assert len(dropping.draw(ring_rig(1), rng)[0]) == 1  # nothing to drop
    assert len(adding.draw(ring_rig(8), rng)[0]) == 8


def test_the_picture_is_written(tmp_path: Path) -> None:
    path = draw_sampler(RigSampler(array=ArrayChange()), ring_rig(3), tmp_path / "sampler.png", draws=6)
    image = cv2.imread(str(path))
    assert image.shape[1] == 1800 and image.std() > 20
