"""Stacking cameras into tensors."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from coin3d.geometry import GroundPlane, fit_width, preset_rig
from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.geometry.image_transform import flipped, rotated


def test_everything_is_stacked_in_order() -> None:
    rig = preset_rig("lyft2")
    ground = GroundPlane(np.array([0.0, 0.1, 1.0]), 0.2)
    batch = CameraTensors.from_cameras(list(rig.values()), [ground] * 6)
    assert len(batch) == 6 and (batch.height_px, batch.width_px) == (1080, 1920)
    assert batch.K.dtype == batch.ego_from_cam.dtype == batch.ground.dtype == torch.float32
    for index, camera in enumerate(rig.values()):
        np.testing.assert_allclose(batch.K[index], camera.K, rtol=1e-6)
        np.testing.assert_allclose(batch.ego_from_cam[index], camera.ego_from_cam.matrix, atol=1e-6)
        # a point of the plane satisfies n . p + d = 0 with the stored four numbers
        point = torch.tensor([3.0, 0.0, 0.0, 1.0])
        point[2] = -(batch.ground[index, 3] + 3 * batch.ground[index, 0]) / batch.ground[index, 2]
        assert abs(float(batch.ground[index] @ point)) < 1e-6


def test_focal_is_that_of_the_cameras() -> None:
    front = preset_rig("nuscenes")["CAM_BACK"]
    plain = fit_width(front, 352, 160)
    cameras = [t.camera(front) for t in (plain, flipped(plain), rotated(plain, 0.09))]
    batch = CameraTensors.from_cameras(cameras, [GroundPlane()] * 3)
    np.testing.assert_allclose(batch.focal_px, [c.focal_px for c in cameras], rtol=1e-6)
    np.testing.assert_allclose(batch.focal_px, 800 * 352 / 1600, rtol=1e-6)


def test_to_keeps_the_size() -> None:
    rig = preset_rig("nuscenes")
    batch = CameraTensors.from_cameras(list(rig.values()), [rig.ground] * 6).to("meta")
    assert batch.K.device.type == batch.ground.device.type == "meta" and (batch.height_px, batch.width_px) == (900, 1600)


def test_mixed_sizes_and_missing_planes() -> None:
    rig = preset_rig("waymo")
    with pytest.raises(ValueError, match=r"exactly one image size, got \[\(886, 1920\), \(1280, 1920\)\]"):
        CameraTensors.from_cameras(list(rig.values()), [rig.ground] * 5)
    with pytest.raises(ValueError, match="exactly one image size"):
        CameraTensors.from_cameras([], [])
    with pytest.raises(ValueError, match="one ground plane per camera, got 1 for 2"):
        CameraTensors.from_cameras([rig["FRONT"], rig["FRONT_LEFT"]], [rig.ground])
