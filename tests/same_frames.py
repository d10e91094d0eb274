"""Whether two frames hold the same, down to pixels and points."""

from __future__ import annotations

import numpy as np

from coin3d.datasets.frame import Frame


def assert_same(
    read: Frame,
    truth: Frame,
    *,
    metres: float = 1e-6,
    mps: float | None = None,
    lidar_metres: float | None = None,
    yaw_rad: float = 1e-3,
    colour_levels: float = 0.0,
) -> None:
    """Everything but own-vehicle masks and ground planes.

    Args:
        read: what a reader gave.
        truth: what was written.
        metres: precision of poses and boxes in the format.
        mps: precision of velocities, by default the same.
        lidar_metres: precision of LiDAR points, by default the same.
        yaw_rad: an upright box keeps its heading only up to the lean of the vehicle where boxes are stored in its frame.
        colour_levels: by how much pixels may differ on average, out of 255; none where images are stored without loss.
    """
    names = ("token", "timestamp_ns", "scene", "previous", "next")
    assert [getattr(read, n) for n in names] == [getattr(truth, n) for n in names]
    np.testing.assert_allclose(read.world_from_ego.matrix, truth.world_from_ego.matrix, rtol=0, atol=metres)
    assert list(read.rig) == list(truth.rig)
    for name, camera in truth.rig.items():
        assert (read.rig[name].width_px, read.rig[name].height_px) == (camera.width_px, camera.height_px)
        np.testing.assert_allclose(read.rig[name].K, camera.K, rtol=1e-9)
        assert read.rig[name].lens == camera.lens
        np.testing.assert_allclose(read.rig[name].ego_from_cam.matrix, camera.ego_from_cam.matrix, rtol=0, atol=metres)
        _assert_same_image(read.image(name), truth.image(name), colour_levels)
    assert (read.boxes_world is None) == (truth.boxes_world is None)
    if read.boxes_world is not None and truth.boxes_world is not None:
        for name in ("labels", "instance_ids", "num_lidar_points", "visibility"):
            assert getattr(read.boxes_world, name).tolist() == getattr(truth.boxes_world, name).tolist()
        for name, within in (("centre_m", metres), ("size_m", metres), ("velocity_mps", metres if mps is None else mps)):
            np.testing.assert_allclose(
                getattr(read.boxes_world, name), getattr(truth.boxes_world, name), rtol=0, atol=within, err_msg=name
            )
        turned = np.angle(np.exp(1j * (read.boxes_world.yaw_rad - truth.boxes_world.yaw_rad)))
        assert np.abs(turned).max(initial=0) < yaw_rad
    assert (read.lidar is None) == (truth.lidar is None)
    if read.lidar is not None and truth.lidar is not None:
        ours, theirs = read.lidar.load(), truth.lidar.load()
        np.testing.assert_allclose(
            ours.points_ego, theirs.points_ego, rtol=0, atol=metres if lidar_metres is None else lidar_metres
        )
        np.testing.assert_allclose(ours.intensity, theirs.intensity, atol=1e-6)
        np.testing.assert_allclose(ours.origin_ego, theirs.origin_ego, rtol=0, atol=metres)


def _assert_same_image(read: np.ndarray, truth: np.ndarray, colour_levels: float) -> None:
    if colour_levels == 0:
        np.testing.assert_array_equal(read, truth)
    else:
        assert read.shape == truth.shape and read.dtype == truth.dtype
        assert np.abs(read.astype(int) - truth.astype(int)).mean() < colour_levels
