"""The town, written as a user's own folder, reads back to the same frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from coin3d.datasets.folder_writer import write_folder_recording
from coin3d.datasets.nuscenes_format import NuScenesRecording
from coin3d.datasets.own_recording import OwnRecording
from coin3d.geometry import Rig
from coin3d.town import TownOptions, record


def test_a_copy_of_the_town(two_cameras: Rig, tmp_path: Path) -> None:
    options = TownOptions(traffic=0.5, people=0.4)
    record(two_cameras, tmp_path / "town", [2], key_frames=2, progress=lambda line: None, options=options)
    town = NuScenesRecording(tmp_path / "town")
    assert write_folder_recording(town, tmp_path / "copy") == 2
    for frame, copy in zip(town, OwnRecording(tmp_path / "copy"), strict=True):
        links = (frame.token, frame.timestamp_ns, frame.scene, frame.previous, frame.next)
        assert (copy.token, copy.timestamp_ns, copy.scene, copy.previous, copy.next) == links
        assert frame.boxes_world is not None and copy.boxes_world is not None and len(frame.boxes_world) > 5
        for name, column in vars(frame.boxes_world).items():
            np.testing.assert_array_equal(getattr(copy.boxes_world, name), column, name)
        for name, camera in frame.rig.items():
            np.testing.assert_array_equal(copy.image(name), frame.image(name))
            np.testing.assert_array_equal(copy.rig[name].K, camera.K)
            assert copy.rig[name].ego_from_cam.allclose(camera.ego_from_cam, 1e-12)
        assert frame.lidar is not None and copy.lidar is not None
        points = copy.world_from_ego.apply(copy.lidar.load().points_ego)
        np.testing.assert_allclose(copy.lidar.load().points_ego, frame.lidar.load().points_ego, atol=1e-5)
        np.testing.assert_array_equal(copy.boxes_world.count_points(points), frame.boxes_world.num_lidar_points)
