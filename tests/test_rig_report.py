"""Numbers and pictures of one rig and of two."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from coin3d.geometry import Camera, GroundPlane, Rig, camera_pose, preset_rig, save_rig
from coin3d.rig_report import compare_rigs, find_rig, rig_difference, rig_facts, show_rig
from coin3d.rig_report.facts import at_network_input, coverage_azimuths_rad, ground_profile, seen_by
from coin3d.rig_report.map_figure import as_rgb

PICTURES = ["top_view.png", "prior_maps.png", "ground_growth.png", "pluecker_ring.png"]


def test_numbers_of_a_camera() -> None:
    front = rig_facts(preset_rig("nuscenes")).cameras[0]
    assert front.name == "CAM_FRONT" and front.size_px == (1600, 900)
    assert front.focal_px == pytest.approx(1250) and front.input_focal_px == pytest.approx(550)
    assert front.inverse_focal == pytest.approx((500 / 550) ** 2)
    # the last row's centre lies 197.5 px below the horizon
    assert front.nearest_ground_m == pytest.approx(1.5 * 550 / 197.5)
    rows_below = 1.5 * 550 / 20
    assert front.growth_m_per_row == pytest.approx(1.5 * 550 / (rows_below - 1) - 20)


def test_angles_are_those_the_camera_was_mounted_with() -> None:
    K = np.array([[400.0, 0, 320], [0, 400, 240], [0, 0, 1]])
    pose = camera_pose((1, 0, 1.5), np.deg2rad(30), np.deg2rad(7), np.deg2rad(-4))
    facts = rig_facts(Rig({"tilted": Camera(K, 640, 480, pose)})).cameras[0]
    assert (facts.yaw_deg, facts.pitch_deg, facts.roll_deg) == pytest.approx((30, 7, -4))


def test_height_is_above_the_ground_plane() -> None:
    rig = preset_rig("waymo")
    lifted = Rig(rig.cameras, GroundPlane(np.array([0, 0, 1.0]), -0.3))
    assert [c.height_m for c in rig_facts(lifted).cameras] == pytest.approx([1.8] * 5)


def test_a_camera_that_sees_no_ground() -> None:
    K = np.array([[400.0, 0, 320], [0, 400, 240], [0, 0, 1]])
    rig = Rig({"sky": Camera(K, 640, 480, camera_pose((0, 0, 1.5), pitch_rad=-1.0))})
    assert rig_facts(rig).cameras[0].nearest_ground_m is None


def test_coverage_by_hand() -> None:
    K = np.array([[320.0, 0, 320], [0, 320, 240], [0, 0, 1]])  # 90 degrees wide

    def at(yaw_deg: float) -> Camera:
        return Camera(K, 640, 480, camera_pose((0, 0, 1.5), np.deg2rad(yaw_deg)))

    facts = rig_facts(Rig({"front": at(0), "left": at(60)}))
    assert facts.covered_deg == pytest.approx(150, abs=0.5)
    assert facts.overlapping_deg == pytest.approx(30, abs=0.5)
    count = seen_by(Rig({"front": at(0)}))
    assert count[np.abs(coverage_azimuths_rad()) < np.deg2rad(44)].all()
    assert not count[np.abs(coverage_azimuths_rad()) > np.deg2rad(46)].any()


def test_presets_cover_what_the_paper_says() -> None:
    for name in ("nuscenes", "lyft1", "lyft2"):
        assert rig_facts(preset_rig(name)).covered_deg == 360
    assert 220 < rig_facts(preset_rig("waymo")).covered_deg < 235  # no rear cameras


def test_differences_pair_the_nearest_directions() -> None:
    change = rig_difference(rig_facts(preset_rig("nuscenes")), rig_facts(preset_rig("waymo")))
    assert change.camera_count_change == -1 and change.covered_change_deg < -120
    front, front_left, front_right, side_left, _ = change.pairs
    assert (front.camera, front.other) == ("CAM_FRONT", "FRONT") and front.yaw_change_deg == pytest.approx(0)
    assert front.input_focal_ratio == pytest.approx((2050 / 1920) / (1250 / 1600), rel=2e-3)
    assert front.height_change_m == pytest.approx(0.6)
    assert front_left.yaw_change_deg == pytest.approx(-10) and front_right.yaw_change_deg == pytest.approx(10)
    assert side_left.camera == "CAM_BACK_LEFT" and side_left.height_change_m == pytest.approx(0.55)


def test_ground_profile_is_the_inverse_depth() -> None:
    camera = at_network_input(preset_rig("lyft1")["CAM_BACK"])
    at_top, per_row = ground_profile(camera, GroundPlane())
    depth = 1 / (at_top + per_row * 500)
    point = camera.ego_from_cam.translation + depth * camera.rays_ego(np.array([camera.width_px / 2, 500.0]))
    assert point[2] == pytest.approx(0, abs=1e-9)


def test_colours_of_vectors() -> None:
    np.testing.assert_allclose(as_rgb(np.array([[0.0, 1.3, -1.3], [9, 0.65, 0]]), 1.3), [[0.5, 1, 0], [1, 0.75, 0.5]])


def test_show_writes_pictures_and_result(tmp_path: Path) -> None:
    K = np.array([[400.0, 0, 320], [0, 410, 200], [0, 0, 1]])
    cameras = {
        "ahead": Camera(K, 640, 480, camera_pose((1.5, 0, 1.2), 0.1, 0.15, 0.05)),
        "up": Camera(K, 400, 300, camera_pose((0, 0, 1.2), 2.0, -1.2)),
        "upside down": Camera(K, 640, 480, camera_pose((0, 0.4, 1.2), 1.5, 0, np.pi)),
    }
    text = show_rig(Rig(cameras, name="odd"), tmp_path / "out")
    assert "odd: 3 cameras" in text and "upside down" in text
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["pictures"] == PICTURES and [c["name"] for c in result["rig"]["cameras"]] == list(cameras)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == sorted([*PICTURES, "result.json"])
    for name in PICTURES:
        picture = cv2.imread(str(tmp_path / "out" / name))
        assert picture is not None and min(picture.shape[:2]) > 300 and picture.std() > 5


def test_compare_writes_both(tmp_path: Path) -> None:
    text = compare_rigs(preset_rig("nuscenes"), preset_rig("waymo"), tmp_path)
    assert "6 cameras become 5" in text and "no counterpart in waymo: CAM_BACK" in text and "x 1.37" in text
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["rig"]["name"] == "nuscenes" and result["other"]["name"] == "waymo"
    assert result["difference"]["camera_count_change"] == -1
    assert all((tmp_path / name).stat().st_size > 10_000 for name in result["pictures"])


def test_find_rig(tmp_path: Path) -> None:
    assert find_rig("lyft2").name == "lyft2"
    save_rig(preset_rig("waymo"), tmp_path / "mine.yaml")
    assert list(find_rig(str(tmp_path / "mine.yaml"))) == list(preset_rig("waymo"))
    with pytest.raises(FileNotFoundError, match=r"missing.yaml: no such rig file"):
        find_rig(str(tmp_path / "missing.yaml"))
    with pytest.raises(ValueError, match="no rig preset 'kitti'"):
        find_rig("kitti")
