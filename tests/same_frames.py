"""Whether two frames hold the same, down to pixels and points."""

from __future__ import annotations

import numpy as np

from coin3d.datasets.frame import Frame


def assert_same(read: Frame, truth: Frame, *, metres: float = 1e-6) -> None:
    """Everything but own-vehicle masks; ``metres`` is the precision of the format."""
    names = ("token", "timestamp_ns", "scene", "previous", "next")
    assert [getattr(read, n) for n in names] == [getattr(truth, n) for n in names]
    np.testing.assert_allclose(read.world_from_ego.matrix, truth.world_from_ego.matrix, atol=metres)
    assert list(read.rig) == list(truth.rig)
    for name, camera in truth.rig.items():
        assert (read.rig[name].width_px, read.rig[name].height_px) == (camera.width_px, camera.height_px)
        np.testing.assert_allclose(read.rig[name].K, camera.K, rtol=1e-9)
        assert read.rig[name].lens == camera.lens
        np.testing.assert_allclose(read.rig[name].ego_from_cam.matrix, camera.ego_from_cam.matrix, atol=metres)
        np.testing.assert_array_equal(read.image(name), truth.image(name))
    assert (read.boxes_world is None) == (truth.boxes_world is None)
    if read.boxes_world is not None and truth.boxes_world is not None:
        for name in ("labels", "instance_ids", "num_lidar_points", "visibility"):
            assert getattr(read.boxes_world, name).tolist() == getattr(truth.boxes_world, name).tolist()
        for name in ("centre_m", "size_m", "velocity_mps"):
            np.testing.assert_allclose(getattr(read.boxes_world, name), getattr(truth.boxes_world, name), atol=metres)
        turned = np.angle(np.exp(1j * (read.boxes_world.yaw_rad - truth.boxes_world.yaw_rad)))
        assert np.abs(turned).max(initial=0) < 1e-3  # an upright box keeps its heading only up to the lean of the vehicle
    assert (read.lidar is None) == (truth.lidar is None)
    if read.lidar is not None and truth.lidar is not None:
        ours, theirs = read.lidar.load(), truth.lidar.load()
        np.testing.assert_allclose(ours.points_ego, theirs.points_ego, atol=metres)
        np.testing.assert_allclose(ours.intensity, theirs.intensity, atol=1e-6)
        np.testing.assert_allclose(ours.origin_ego, theirs.origin_ego, atol=metres)
