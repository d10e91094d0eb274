"""Three samples of a real DGP scene with DDAD's rig: counts, alignment of LiDAR and boxes with the cameras, the ground."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from coin3d.check import check
from coin3d.datasets.classes import THREE_CLASS
from coin3d.datasets.dgp import DgpRecording
from coin3d.datasets.dgp_files import read_boxes
from coin3d.datasets.frame import Frame
from coin3d.datasets.ground_fit import fit_ground

CATEGORIES = {0: "Person", 1: "Truck", 2: "Car"}


@pytest.fixture
def recording(ddad_three_frames: Path) -> DgpRecording:
    return DgpRecording(ddad_three_frames)


def test_counts_and_neighbours(recording: DgpRecording) -> None:
    frames = list(recording)
    assert [len(f.boxes) for f in frames if f.boxes is not None] == [13, 13, 13]
    assert [f.previous for f in frames] == ["", frames[0].token, frames[1].token]
    steps_s = np.diff([f.timestamp_ns for f in frames]) * 1e-9
    np.testing.assert_allclose(steps_s, 1.0, atol=0.02)
    for frame in frames:
        assert list(frame.rig) == [f"CAMERA_0{i}" for i in (1, 5, 6, 7, 8, 9)]
        assert frame.boxes is not None and len(THREE_CLASS.apply(frame.boxes)) == 13
        assert len(set(frame.boxes.instance_ids)) == 13


def test_cameras_sit_where_they_are_mounted_but_for_the_drive_between_the_shots(recording: DgpRecording) -> None:
    mounts = recording._scenes[0].calibration(recording._scenes[0].samples[0]).vehicle_from_sensor
    for frame in recording:
        moved = np.array([c.ego_from_cam.translation - mounts[n].translation for n, c in frame.rig.items()])
        # 1.3 m/s for about 0.09 s, backwards because the images are older
        assert (np.abs(moved[:, 1:]) < 0.02).all() and (moved[:, 0] < 0).all() and (moved[:, 0] > -0.2).all()
        turned = [c.ego_from_cam.rotation.T @ mounts[n].rotation for n, c in frame.rig.items()]
        assert min(np.trace(r) for r in turned) > 3 - 1e-4


def test_boxes_agree_with_the_ones_annotated_in_the_cameras(recording: DgpRecording, ddad_three_frames: Path) -> None:
    """DGP also gives every box in the frame of the camera that sees it, at the camera's own time: an independent way."""
    errors_m = []
    for frame in recording:
        for name, camera in frame.rig.items():
            theirs = read_boxes(_camera_boxes(ddad_three_frames, frame, name), CATEGORIES)
            ours = frame.boxes
            assert ours is not None
            for instance, centre_cam in zip(theirs.instance_ids, theirs.centre_m, strict=True):
                (row,) = np.flatnonzero(ours.instance_ids == instance)
                errors_m.append(np.linalg.norm(camera.ego_from_cam.inverse().apply(ours.centre_m[row]) - centre_cam))
    assert len(errors_m) > 20
    assert np.median(errors_m) < 0.1 and np.mean(np.array(errors_m) < 0.3) > 0.7  # some cars drive


def _camera_boxes(root: Path, frame: Frame, camera: str) -> Path:
    image = Path(str(frame.images[camera]))
    scene = json.loads(next(image.parents[2].glob("scene_*.json")).read_text())
    (datum,) = [d for d in scene["data"] if d["datum"].get("image", {}).get("filename", "").endswith(f"{camera}/{image.name}")]
    return Path(image.parents[2] / datum["datum"]["image"]["annotations"]["1"])


def test_points_lie_in_boxes_and_standing_cars_stand(recording: DgpRecording) -> None:
    for frame in recording:
        boxes, lidar = frame.boxes_world, frame.lidar
        assert boxes is not None and lidar is not None
        counted = boxes.count_points(frame.world_from_ego.apply(lidar.load().points_ego))
        annotated = boxes.num_lidar_points
        # the sweep was thinned to about a fifth after it was counted
        near = annotated > 500
        assert near.any() and (counted[near] / annotated[near] > 0.1).all() and (counted[near] / annotated[near] < 0.35).all()
        speed = np.linalg.norm(boxes.velocity_mps, axis=1)
        assert np.isfinite(speed).all() and np.median(speed) < 0.5


def test_the_ground_of_the_rig_is_the_road(recording: DgpRecording, tmp_path: Path, ddad_three_frames: Path) -> None:
    for frame in recording:
        ground = frame.rig.ground
        assert frame.lidar is not None
        scan = frame.lidar.load()
        near = np.abs(scan.points_ego[:, :2]).max(1) < 6
        low = np.percentile(ground.height_m(scan.points_ego[near]), 20)
        assert abs(low) < 0.15
        fit = fit_ground(scan.points_ego, scan.origin_ego)
        assert fit is not None and np.rad2deg(np.arccos(min(1.0, fit.plane.normal @ ground.normal))) < 1
        heights = [ground.height_m(c.ego_from_cam.translation) for c in frame.rig.values()]
        assert min(heights) > 1.3 and max(heights) < 1.7
    result = check(ddad_three_frames, tmp_path, frames=1)
    assert not [f for f in result.findings if f.severity == "error"]
    assert abs(result.ground_height_m) < 0.15 and result.ground_tilt_deg < 1
