"""Real recordings, written as a user's own folder, are the same recordings."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from coin3d.datasets.folder_writer import write_folder_recording
from coin3d.datasets.open import open_recording


def test_a_copy_of_a_nuscenes_frame_has_the_same_points_in_its_boxes(one_real_frame: Path, tmp_path: Path) -> None:
    frame = open_recording(one_real_frame)[0]
    assert write_folder_recording([frame], tmp_path / "copy") == 1
    copy = open_recording(tmp_path / "copy")[0]
    points = copy.world_from_ego.apply(copy.lidar.load().points_ego)
    np.testing.assert_array_equal(copy.boxes_world.count_points(points), frame.boxes_world.num_lidar_points)
    np.testing.assert_array_equal(copy.boxes_world.num_lidar_points, frame.boxes_world.num_lidar_points)
    assert copy.boxes_world.labels.tolist() == frame.boxes_world.labels.tolist()
    for name in frame.rig:
        assert copy.images[name].read_bytes() == frame.images[name].read_bytes()
        assert copy.rig[name].ego_from_cam.allclose(frame.rig[name].ego_from_cam, 1e-12)


def test_a_copy_of_ddad_keeps_tracks_ground_and_poses(ddad_three_frames: Path, tmp_path: Path) -> None:
    frames = list(open_recording(ddad_three_frames))
    write_folder_recording(frames, tmp_path / "copy")
    for frame, copy in zip(frames, open_recording(tmp_path / "copy"), strict=True):
        assert (copy.token, copy.timestamp_ns, copy.previous, copy.next) == (
            frame.token, frame.timestamp_ns, frame.previous, frame.next,
        )  # fmt: skip
        assert copy.boxes_world.instance_ids.tolist() == frame.boxes_world.instance_ids.tolist()
        np.testing.assert_array_equal(copy.boxes_world.velocity_mps, frame.boxes_world.velocity_mps)
        np.testing.assert_allclose(copy.rig.ground.normal, frame.rig.ground.normal, atol=1e-12)
        assert copy.world_from_ego.allclose(frame.world_from_ego, 1e-9)
        np.testing.assert_allclose(copy.lidar.load().points_ego, frame.lidar.load().points_ego, atol=2e-5)
