"""The nuScenes-format reader against a recording whose every number is known."""

from __future__ import annotations

import shutil
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from coin3d.datasets.nuscenes_format import NuScenesRecording
from tiny_recording import CAMERAS, EGO_FROM_LIDAR, POLE_WORLD, START_US, edit_table, world_from_ego, write_recording


def test_frames_come_scene_by_scene_with_their_neighbours(tiny_recording: Path) -> None:
    edit_table(tiny_recording, "sample", lambda rows: rows.reverse())
    recording = NuScenesRecording(tiny_recording)
    assert [f.token for f in recording] == [f"sample{s}.{k}" for s in range(2) for k in range(3)]
    assert [(f.previous, f.next) for f in recording][:4] == [
        ("", "sample0.1"),
        ("sample0.0", "sample0.2"),
        ("sample0.1", ""),
        ("", "sample1.1"),
    ]
    assert recording[4].scene == "street-1"
    assert recording[-1].token == "sample1.2"
    assert recording.frame_by_token("sample1.1").timestamp_ns == (START_US + 60_500_000) * 1000
    with pytest.raises(KeyError, match="nowhere"):
        recording.frame_by_token("nowhere")
    with pytest.raises(IndexError):
        recording[6]


def test_known_cameras_first_then_by_name(tiny_recording: Path) -> None:
    assert list(NuScenesRecording(tiny_recording)[0].rig) == ["CAM_FRONT", "CAM_BACK", "A_SIDE_EYE"]


def test_intrinsics_move_from_opencv_to_pixel_edges(tiny_recording: Path) -> None:
    camera = NuScenesRecording(tiny_recording)[0].rig["CAM_FRONT"]
    np.testing.assert_allclose(camera.K, np.array([[60, 0, 48], [0, 60, 32], [0, 0, 1]]))
    assert (camera.width_px, camera.height_px) == (96, 64)


def test_camera_poses_contain_the_ego_motion_since_they_fired(tiny_recording: Path) -> None:
    frame = NuScenesRecording(tiny_recording)[1]
    for name, ego_from_cam in CAMERAS.items():
        pose = frame.rig[name].ego_from_cam
        # the ego drove 0.04 m forward between camera and LiDAR
        np.testing.assert_allclose(pose.translation, ego_from_cam.translation - np.array([0.04, 0, 0]), atol=1e-9)
        np.testing.assert_allclose(pose.rotation, ego_from_cam.rotation, atol=1e-9)
        point_world = (world_from_ego(0.96) @ ego_from_cam).apply(np.array([0.3, -0.2, 7.0]))
        pixel, depth_m = frame.rig[name].project(frame.world_from_ego.inverse().apply(point_world))
        assert depth_m == pytest.approx(7.0, abs=1e-9)
        np.testing.assert_allclose(pixel, [48 + 60 * 0.3 / 7, 32 - 60 * 0.2 / 7], atol=1e-6)


def test_boxes(tiny_recording: Path) -> None:
    boxes = NuScenesRecording(tiny_recording)[0].boxes_world
    assert boxes is not None
    assert boxes.labels.tolist() == ["vehicle.car", "human.pedestrian.adult"]
    assert boxes.instance_ids.tolist() == ["car0", "walker0"]
    assert boxes.num_lidar_points.tolist() == [7, 0]
    np.testing.assert_allclose(boxes.size_m[0], [4.0, 2.0, 1.5])


def test_visibility_is_the_level_or_unknown(tiny_recording: Path) -> None:
    assert NuScenesRecording(tiny_recording)[0].boxes_world.visibility.tolist() == [3, 0]

    def judge(rows: list[dict[str, Any]]) -> None:
        tokens = {"ann_car0.0": "4", "ann_walker0": "1", "ann_car0.1": "", "ann_car0.2": None, "ann_car1.0": "half"}
        for row in rows:
            row["visibility_token"] = tokens.get(row["token"], "2")

    edit_table(tiny_recording, "sample_annotation", judge)
    levels = [frame.boxes.visibility.tolist() for frame in NuScenesRecording(tiny_recording)]
    assert levels == [[4, 1], [0], [0], [0, 2], [2], [2]]


def test_velocity_is_centred_one_sided_at_the_ends_and_unknown_for_single_boxes(tiny_recording: Path) -> None:
    recording = NuScenesRecording(tiny_recording)
    for index in range(3):
        boxes = recording[index].boxes_world
        assert boxes is not None
        np.testing.assert_allclose(boxes.velocity_mps[0], [2.0, 0.0], atol=1e-6)
    first = recording[0].boxes_world
    assert first is not None and np.isnan(first.velocity_mps[1]).all()


def test_velocity_does_not_bridge_long_gaps_or_missing_neighbours(tiny_recording: Path) -> None:
    def delay(rows: list[dict]) -> None:
        for row in rows:
            row["timestamp"] += int(row["token"][-1]) * 2_000_000

    edit_table(tiny_recording, "sample", delay)
    boxes = NuScenesRecording(tiny_recording)[1].boxes_world
    assert boxes is not None and np.isnan(boxes.velocity_mps).all()
    edit_table(tiny_recording, "sample_annotation", lambda rows: [row.update(prev="gone") for row in rows])
    assert len(NuScenesRecording(tiny_recording)[1].boxes) == 1


def test_lidar_and_sweeps_share_the_ego_frame_of_the_key_frame(tiny_recording: Path) -> None:
    recording = NuScenesRecording(tiny_recording)
    frame = recording[1]
    scan = frame.lidar.load()
    np.testing.assert_allclose(scan.origin_ego, EGO_FROM_LIDAR.translation, atol=1e-9)
    pole_ego = world_from_ego(1.0).inverse().apply(POLE_WORLD)
    np.testing.assert_allclose(scan.points_ego[0], pole_ego, atol=1e-5)
    counts = frame.boxes_world.count_points(frame.world_from_ego.apply(scan.points_ego))
    np.testing.assert_array_equal(counts, frame.boxes_world.num_lidar_points)
    sweeps = recording.sweeps(frame)
    assert [t - frame.timestamp_ns for t, _ in sweeps] == [166_000_000, 332_000_000]
    for part, (_, sweep) in enumerate(sweeps, start=1):
        points = sweep.load()
        np.testing.assert_allclose(points.points_ego[0], pole_ego, atol=1e-5)
        np.testing.assert_allclose(points.origin_ego, EGO_FROM_LIDAR.translation + np.array([part / 3, 0, 0]), atol=1e-9)


def test_no_annotations_at_all_means_no_labels_but_none_in_one_frame_means_empty(tiny_recording: Path) -> None:
    edit_table(tiny_recording, "sample_annotation", lambda rows: rows.__delitem__(slice(0, 2)))
    assert len(NuScenesRecording(tiny_recording)[0].boxes_world) == 0
    edit_table(tiny_recording, "sample_annotation", lambda rows: rows.clear())
    assert NuScenesRecording(tiny_recording)[0].boxes_world is None


def test_without_lidar_the_first_camera_gives_the_reference(tiny_recording: Path) -> None:
    edit_table(tiny_recording, "sensor", lambda rows: rows[-1].update(modality="radar"))
    frame = NuScenesRecording(tiny_recording)[0]
    assert frame.lidar is None
    assert frame.timestamp_ns == (START_US - 20_000) * 1000
    assert frame.rig["CAM_FRONT"].ego_from_cam.allclose(CAMERAS["CAM_FRONT"])


def test_version_folders(tiny_recording: Path, tmp_path: Path) -> None:
    assert len(NuScenesRecording(tiny_recording / "v1.0-tiny")) == 6
    frame = NuScenesRecording(tiny_recording / "v1.0-tiny")[0]
    assert frame.image("CAM_FRONT").shape == (64, 96, 3)
    nested = tmp_path / "lyft"
    shutil.copytree(tiny_recording / "v1.0-tiny", nested / "v1.01-train" / "v1.01-train")
    assert len(NuScenesRecording(nested)) == len(NuScenesRecording(nested, "v1.01-train")) == 6
    shutil.copytree(tiny_recording / "v1.0-tiny", tiny_recording / "v1.0-other")
    with pytest.raises(ValueError, match=r"several versions \(v1.0-other, v1.0-tiny\)"):
        NuScenesRecording(tiny_recording)
    assert len(NuScenesRecording(tiny_recording, version="v1.0-tiny")) == 6
    with pytest.raises(FileNotFoundError, match="no folder with nuScenes-format tables"):
        NuScenesRecording(tiny_recording, version="v1.0-mini")


def test_six_hundred_frames_open_within_a_second(tmp_path: Path) -> None:
    root = write_recording(tmp_path / "long", scenes=30, samples=20, files=False)
    start = time.process_time()
    assert len(NuScenesRecording(root)) == 600
    assert time.process_time() - start < 1.0
