"""One real nuScenes key frame: counts, calibration, alignment of LiDAR and images."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from coin3d.check import check
from coin3d.datasets.classes import THREE_CLASS
from coin3d.datasets.nuscenes_format import NuScenesRecording
from coin3d.geometry import preset_rig


def test_every_box_holds_exactly_its_lidar_points(one_real_frame: Path, tmp_path: Path) -> None:
    result = check(one_real_frame, tmp_path)
    assert result.boxes == result.boxes_with_lidar_count == result.boxes_with_matching_lidar_count == 68
    assert not [f for f in result.findings if f.severity == "error"]
    assert abs(result.ground_height_m) < 0.1 and result.ground_tilt_deg < 2


def test_calibration_is_that_of_the_papers_table(one_real_frame: Path) -> None:
    rig, table = NuScenesRecording(one_real_frame)[0].rig, preset_rig("nuscenes")
    assert list(rig) == list(table)
    for name, camera in rig.items():
        assert camera.focal_px == pytest.approx(table[name].focal_px, rel=0.03)
        assert camera.height_m == pytest.approx(1.5, abs=0.12)
        assert np.cos(camera.yaw_rad - table[name].yaw_rad) > np.cos(np.deg2rad(4))


def test_boxes_survive_the_way_to_the_ego_frame_and_back(one_real_frame: Path) -> None:
    frame = NuScenesRecording(one_real_frame)[0]
    back = frame.boxes.transformed(frame.world_from_ego)
    np.testing.assert_allclose(back.centre_m, frame.boxes_world.centre_m, atol=1e-6)
    assert ((frame.boxes.yaw_rad > -np.pi) & (frame.boxes.yaw_rad <= np.pi)).all()
    # an upright box keeps its heading only up to the lean of the vehicle
    assert np.abs(np.angle(np.exp(1j * (back.yaw_rad - frame.boxes_world.yaw_rad)))).max() < 1e-3
    assert len(THREE_CLASS.apply(frame.boxes)) == 43


def _near_sides_of_depth_steps(path: Path) -> np.ndarray:
    """Rows of the LiDAR file where the range along a ring steps by more than 2 m, between 4 m and 25 m."""
    records = np.fromfile(path, dtype="<f4").reshape(-1, 5)
    azimuth_rad, range_m = np.arctan2(records[:, 1], records[:, 0]), np.linalg.norm(records[:, :3], axis=1)
    order = np.lexsort((azimuth_rad, records[:, 4]))
    neighbours = (np.diff(records[order, 4]) == 0) & (np.diff(azimuth_rad[order]) < np.deg2rad(0.6))
    step_m = np.diff(range_m[order])
    rows = np.concatenate([order[:-1][neighbours & (step_m > 2)], order[1:][neighbours & (step_m < -2)]])
    return rows[(range_m[rows] > 4) & (range_m[rows] < 25)]


def test_lidar_edges_lie_on_image_edges(one_real_frame: Path) -> None:
    """Image edges are strongest where depth steps project to, and weaker a few pixels beside: the whole chain is right."""
    frame = NuScenesRecording(one_real_frame)[0]
    points = frame.lidar.load().points_ego[_near_sides_of_depth_steps(frame.lidar.path)]
    shifts_px = np.arange(-40, 41, 5)
    strength = np.zeros(len(shifts_px))
    for name, camera in frame.rig.items():
        grey = cv2.GaussianBlur(cv2.cvtColor(frame.image(name), cv2.COLOR_RGB2GRAY), (0, 0), 1.5).astype(np.float64)
        edges = cv2.dilate(np.abs(cv2.Sobel(grey, cv2.CV_64F, 1, 0)), np.ones((1, 5)))
        pixels = np.floor(camera.project(points[camera.sees(points)])[0]).astype(int)
        for i, shift in enumerate(shifts_px):
            strength[i] += edges[pixels[:, 1], (pixels[:, 0] + shift).clip(0, camera.width_px - 1)].sum()
    assert abs(shifts_px[np.argmax(strength)]) <= 5
    assert strength[shifts_px == 0] > 1.3 * strength[np.abs(shifts_px) >= 15].max()
