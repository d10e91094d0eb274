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


def _along_the_rings(points_ego: np.ndarray) -> np.ndarray:
    """Order in which consecutive points are neighbours on a scan line (1.33 degrees apart, sensor at (0.94, 0, 1.84))."""
    offset = points_ego - [0.94, 0.0, 1.84]
    elevation_deg = np.rad2deg(np.arctan2(offset[:, 2], np.hypot(offset[:, 0], offset[:, 1])))
    return np.lexsort((np.arctan2(offset[:, 1], offset[:, 0]), np.round(elevation_deg / 1.33)))


def test_lidar_edges_lie_on_image_edges(one_real_frame: Path) -> None:
    """Depth steps along the scan lines meet stronger image edges than shifted ones: the calibration chain is right."""
    frame = NuScenesRecording(one_real_frame)[0]
    points = frame.lidar.load().points_ego
    scores = np.zeros(3)
    for name, camera in frame.rig.items():
        grey = cv2.GaussianBlur(cv2.cvtColor(frame.image(name), cv2.COLOR_RGB2GRAY), (0, 0), 2).astype(np.float64)
        strength = np.abs(np.gradient(grey, axis=1))
        pixels, depth_m = camera.project(points)
        seen = camera.sees(points)
        order = _along_the_rings(points)
        step_m = depth_m[order][1:] - depth_m[order][:-1]
        edge = order[:-1][(step_m > 3.0) & seen[order][:-1] & (depth_m[order][:-1] < 30)]
        for i, shift in enumerate((-25, 0, 25)):
            at = np.floor(pixels[edge] + [shift, 0]).astype(int)
            inside = (at[:, 0] >= 2) & (at[:, 0] < camera.width_px - 2)
            best = np.stack([strength[at[inside, 1], at[inside, 0] + d] for d in range(-2, 3)]).max(0)
            scores[i] += best.mean()
    assert scores[1] > 1.2 * max(scores[0], scores[2])
