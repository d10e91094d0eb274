"""Rigs, ground planes and the rigs of the paper's table."""

from __future__ import annotations

import numpy as np
import pytest

from coin3d.geometry import RIG_PRESETS, Camera, GroundPlane, Rig, camera_pose, preset_rig

CAMERA = Camera(np.array([[100.0, 0, 60], [0, 100, 40], [0, 0, 1]]), 120, 80, camera_pose((1, 0, 1.5)))


def test_a_rig_is_an_ordered_mapping() -> None:
    rig = Rig({"b": CAMERA, "a": CAMERA})
    assert list(rig) == ["b", "a"] and len(rig) == 2 and rig["a"] is CAMERA
    assert list(rig.with_cameras({"c": CAMERA})) == ["c"]
    with pytest.raises(KeyError, match="no camera 'c'"):
        rig["c"]


def test_a_rig_needs_cameras_above_the_ground() -> None:
    with pytest.raises(ValueError, match="no cameras"):
        Rig({}, name="mine")
    with pytest.raises(ValueError, match=r"camera 'low'.*ego_from_vehicle"):
        Rig({"ok": CAMERA, "low": CAMERA.moved(camera_pose((1, 0, -0.2)))})
    with pytest.raises(ValueError, match="'x'"):
        Rig({"x": CAMERA}, ground=GroundPlane(np.array([0, 0, 1]), -1.5))


def test_a_rig_sees_what_one_camera_sees() -> None:
    rig = Rig({"front": CAMERA, "back": CAMERA.moved(camera_pose((-1, 0, 1.5), np.pi))})
    assert rig.sees(np.array([[10.0, 0, 1], [-10.0, 0, 1], [0.0, 10, 1]])).tolist() == [True, True, False]


def test_ground_plane_heights() -> None:
    plane = GroundPlane(np.array([0.0, 0, 2]), -0.6)
    assert plane.offset_m == pytest.approx(-0.3)  # normalised with the normal
    np.testing.assert_allclose(plane.height_m(np.array([[5.0, 5, 0.3], [0, 0, 1.3]])), [0, 1])
    assert GroundPlane().is_default and not plane.is_default


@pytest.mark.parametrize(
    ("normal", "offset", "message"),
    [
        ((0, 0, 0), 0, "point up"),
        ((0, 0, -1), 0, "point up"),
        ((0, 1), 0, "finite"),
        ((0, 0, np.nan), 0, "finite"),
        ((0, 0, 1), np.inf, "finite"),
    ],
)
def test_bad_ground_planes(normal: tuple[float, ...], offset: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        GroundPlane(np.array(normal, dtype=float), offset)


# paper supplement, table dataset_infos: focal, image size, rounded fields of view, position, yaw
TABLE = {
    "nuscenes": {
        "CAM_FRONT": (1250, (1600, 900), 65, 40, (1.7, 0, 1.5), 0),
        "CAM_FRONT_LEFT": (1250, (1600, 900), 65, 40, (1.55, 0.5, 1.5), 55),
        "CAM_FRONT_RIGHT": (1250, (1600, 900), 65, 40, (1.55, -0.5, 1.5), -55),
        "CAM_BACK": (800, (1600, 900), 90, 60, (0, 0, 1.5), 180),
        "CAM_BACK_LEFT": (1250, (1600, 900), 65, 40, (1.0, 0.5, 1.55), 110),
        "CAM_BACK_RIGHT": (1250, (1600, 900), 65, 40, (1.0, -0.5, 1.55), -110),
    },
    "lyft1": {
        "CAM_FRONT": (880, (1224, 1024), 70, 60, (1.5, 0, 1.7), 0),
        "CAM_FRONT_LEFT": (880, (1224, 1024), 70, 60, (1.3, 0.3, 1.7), 60),
        "CAM_FRONT_RIGHT": (880, (1224, 1024), 70, 60, (1.3, -0.3, 1.7), -60),
        "CAM_BACK": (880, (1224, 1024), 70, 60, (0.8, 0, 1.65), 180),
        "CAM_BACK_LEFT": (880, (1224, 1024), 70, 60, (1.0, 0.3, 1.65), 120),
        "CAM_BACK_RIGHT": (880, (1224, 1024), 70, 60, (1.0, -0.3, 1.65), -120),
    },
    "lyft2": {
        "CAM_FRONT": (1100, (1920, 1080), 80, 50, (1.5, 0, 1.65), 0),
        "CAM_FRONT_LEFT": (1100, (1920, 1080), 80, 50, (1.3, 0.3, 1.65), 60),
        "CAM_FRONT_RIGHT": (1100, (1920, 1080), 80, 50, (1.3, -0.3, 1.65), -60),
        "CAM_BACK": (1100, (1920, 1080), 80, 50, (0.8, 0, 1.65), 180),
        "CAM_BACK_LEFT": (1100, (1920, 1080), 80, 50, (1.0, 0.3, 1.65), 120),
        "CAM_BACK_RIGHT": (1100, (1920, 1080), 80, 50, (1.0, -0.3, 1.65), -120),
    },
    "waymo": {
        "FRONT": (2050, (1920, 1280), 50, 35, (1.55, 0, 2.1), 0),
        "FRONT_LEFT": (2050, (1920, 1280), 50, 35, (1.5, 0.1, 2.1), 45),
        "FRONT_RIGHT": (2050, (1920, 1280), 50, 35, (1.5, -0.1, 2.1), -45),
        "SIDE_LEFT": (2050, (1920, 886), 50, 35, (1.4, 0.1, 2.1), 90),
        "SIDE_RIGHT": (2050, (1920, 886), 50, 35, (1.4, -0.1, 2.1), -90),
    },
}


@pytest.mark.parametrize("name", list(TABLE))
def test_presets_are_the_papers_table(name: str) -> None:
    rig = preset_rig(name)
    assert set(rig) == set(TABLE[name]) and set(RIG_PRESETS) == set(TABLE)
    for camera_name, (focal, size, horizontal_deg, vertical_deg, position, yaw_deg) in TABLE[name].items():
        camera = rig[camera_name]
        assert camera.focal_px == pytest.approx(focal) and (camera.width_px, camera.height_px) == size
        assert np.rad2deg(camera.fov_horizontal_rad) == pytest.approx(horizontal_deg, abs=3)
        assert np.rad2deg(camera.fov_vertical_rad) == pytest.approx(vertical_deg, abs=3)
        np.testing.assert_allclose(camera.ego_from_cam.translation, position)
        assert abs(np.rad2deg(camera.yaw_rad)) == pytest.approx(abs(yaw_deg))
        assert camera.ego_from_cam.rotation[2, 2] == pytest.approx(0)  # looks at the horizon


def test_scaled_presets_see_the_same() -> None:
    full, small = preset_rig("waymo"), preset_rig("waymo", width_px=704)
    point = np.array([12.0, 1.0, 0.5])
    for name in full:
        assert small[name].width_px == 704
        if full[name].sees(point):
            scale = np.array([704 / 1920, small[name].height_px / full[name].height_px])
            np.testing.assert_allclose(small[name].project(point)[0], full[name].project(point)[0] * scale)


def test_unknown_preset() -> None:
    with pytest.raises(ValueError, match=r"no rig preset 'kitti'.*nuscenes"):
        preset_rig("kitti")
