"""The 27 numbers of a camera, by hand for a nuScenes image resized by 0.44 and cut at 140 rows."""

from __future__ import annotations

import numpy as np
import torch

from coin3d.geometry import Camera, GroundPlane, camera_pose, fit_width
from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.methods import Direct, DirectOptions
from coin3d.methods.released_camera_numbers import ReleasedCameraNumbers


def test_by_hand() -> None:
    own = np.array([[1266.0, 0, 816.0], [0, 1260.0, 491.0], [0, 0, 1]])
    K = own.copy()
    K[:2, 2] += 0.5  # OpenCV counts from the centre of the first pixel
    pose = camera_pose((1.5, 0.1, 1.6), 0.3)
    cropped = np.array([[0.44, 0, 0], [0, 0.44, -140.0], [0, 0, 1]])
    half = np.eye(3)
    half[:2, 2] = 0.5
    camera = CameraTensors.from_cameras([Camera(half @ cropped @ own, 704, 256, pose)], [GroundPlane()])
    bev = torch.tensor([[[0.9, -0.1, 0.0], [0.1, 0.9, 0.0], [0.0, 0.0, 1.02]]])
    method = Direct(DirectOptions(released=ReleasedCameraNumbers()))
    assert method.camera_vector_channels == 27
    vector = method.camera_vector(camera, bev, None)[0]
    expected = [1266, 1260, 816, 491, 0.44, 0, 0, 0, 0.44, -140, 0.9, -0.1, 0.1, 0.9, 1.02, *pose.matrix[:3].reshape(-1)]
    np.testing.assert_allclose(vector.numpy(), expected, rtol=1e-5, atol=1e-5)
    # our own resize keeps pixel edges, theirs the first centre: the principal points differ by less than a pixel
    ours = Camera(K, 1600, 900, pose)
    fitted = CameraTensors.from_cameras([fit_width(ours, 704, 256).camera(ours)], [GroundPlane()])
    np.testing.assert_allclose(method.camera_vector(fitted, bev, None)[0].numpy(), expected, rtol=1e-5, atol=0.7)


def test_without_them_direct_transfer_gives_its_own() -> None:
    assert Direct().camera_vector_channels == 23
