"""What image cells are told they show: a box straight ahead worked out by hand, and what must not matter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from coin3d.augmentation import transform_boxes
from coin3d.detectors.perspective import PerspectiveTargets, lift_perspective, perspective_loss, perspective_targets
from coin3d.geometry import Boxes3D, Camera, GroundPlane, camera_pose
from coin3d.geometry.camera_tensors import CameraTensors
from small_world import CONFIG, batch, detector, ring_rig, sample

STRIDE = 8
K = np.array([[100.0, 0, 80], [0, 100, 40], [0, 0, 1]])


def camera(height_m: float = 1.0, yaw_rad: float = 0.0, K: np.ndarray = K) -> CameraTensors:
    pose = camera_pose((0.0, 0.0, height_m), yaw_rad)
    return CameraTensors.from_cameras([Camera(K, 160, 80, pose)], [GroundPlane()])


def car(x: float, y: float, yaw: float = 0.0, size: tuple[float, float, float] = (4.0, 2.0, 2.0)) -> Boxes3D:
    return Boxes3D.create([(x, y, size[2] / 2)], [size], [yaw], ["car"])


def test_a_car_straight_ahead() -> None:
    """Centre 12 m ahead at the height of the camera; its rear face, 10 m away, spans 20 px: columns 70-90, rows 30-50."""
    targets = perspective_targets([car(12.0, 0.0)], camera(), STRIDE)
    rows, columns = np.nonzero(targets.object[0].numpy())
    assert (set(rows), set(columns)) == ({4, 5}, {9, 10})  # cells whose centres, 36 and 44 or 76 and 84 px, lie on it
    cover = targets.cover[0].numpy()
    assert cover.sum() * STRIDE**2 == pytest.approx(21 * 21, rel=0.02)  # the outline's pixels are counted in
    assert cover[0].sum() == 0 and cover[4, 9] == 1
    offset_x, offset_y, distance, sine, cosine = targets.values[0, :, 4, 9].numpy()
    assert (offset_x, offset_y) == pytest.approx(((80 - 76) / 16, (40 - 36) / 16))
    assert distance == pytest.approx(2 * np.log(12 * 160 / 100 / 25))
    bearing = np.arctan2(80 - 76, 100)  # the ray of the cell, to the left
    assert (sine, cosine) == pytest.approx((-np.sin(bearing), np.cos(bearing)))


def test_the_nearest_object_owns_a_cell() -> None:
    boxes = Boxes3D.concatenate([car(8.0, 0.0, size=(2.0, 1.0, 1.0)), car(30.0, 0.0, size=(4.0, 4.0, 4.0))])
    values = perspective_targets([boxes], camera(), STRIDE).values[0]
    assert values[2, 5, 9] == pytest.approx(2 * np.log(8 * 1.6 / 25))
    assert values[2, 4, 9] == pytest.approx(2 * np.log(30 * 1.6 / 25))


def test_no_outline_of_a_box_that_reaches_behind_the_camera() -> None:
    for boxes in (car(1.0, 0.0), car(-12.0, 0.0), car(12.0, 40.0), Boxes3D.empty()):
        targets = perspective_targets([boxes], camera(), STRIDE)
        assert not targets.object.any() and targets.cover.sum() == 0 and not targets.values.any()


def test_mounting_does_not_matter_and_a_longer_lens_brings_things_nearer() -> None:
    here = perspective_targets([car(12.0, 2.0, 0.4)], camera(), STRIDE)
    turned = np.array([[np.cos(1.1), -np.sin(1.1), 0], [np.sin(1.1), np.cos(1.1), 0], [0, 0, 1]])
    elsewhere = perspective_targets([transform_boxes(car(12.0, 2.0, 0.4), turned)], camera(yaw_rad=1.1), STRIDE)
    torch.testing.assert_close(elsewhere.values, here.values, atol=1e-4, rtol=0)
    longer = perspective_targets([car(12.0, 2.0, 0.4)], camera(K=np.array([[200.0, 0, 80], [0, 200, 40], [0, 0, 1]])), STRIDE)
    both = here.object & longer.object
    assert both.any()
    change = (longer.values - here.values)[0, 2][both[0]]
    torch.testing.assert_close(change, torch.full_like(change, 2 * np.log(0.5)))


@pytest.mark.parametrize("K_", [K, np.array([[220.0, 0, 70], [0, 200, 35], [0, 0, 1]])])
def test_lifting_the_targets_gives_the_objects(K_: np.ndarray) -> None:
    """From wherever in the outline of a car, through any lens, mounted anyhow, its place and heading come back."""
    pose = camera_pose((3.0, 1.0, 1.7), 0.5)
    cameras = CameraTensors.from_cameras([Camera(K_, 160, 80, pose)], [GroundPlane()])
    box = car(3.0 + 15 * np.cos(0.45), 1.0 + 15 * np.sin(0.45), yaw=-2.2)
    targets = perspective_targets([box], cameras, STRIDE)
    centre_m, heading = lift_perspective(torch.cat([targets.cover[:, None], targets.values], dim=1), cameras, STRIDE)
    shown = targets.object[0]
    assert shown.sum() >= 4
    np.testing.assert_allclose(centre_m[0][:, shown].T, np.broadcast_to(box.centre_m, (int(shown.sum()), 3)), atol=1e-3)
    yaw = torch.atan2(heading[0, 1], heading[0, 0])[shown]
    torch.testing.assert_close(yaw, torch.full_like(yaw, -2.2), atol=1e-4, rtol=0)


def test_loss_is_zero_only_at_the_truth() -> None:
    targets = perspective_targets([car(12.0, 0.0)], camera(), STRIDE)
    targets = PerspectiveTargets(targets.cover.round(), targets.object, targets.values)
    perfect = torch.cat([40.0 * (2 * targets.cover[:, None] - 1), targets.values], dim=1)
    assert perspective_loss(perfect, targets) < 1e-6
    worse = perfect.clone()
    worse[:, 3][targets.object] += 0.5
    assert perspective_loss(worse, targets) == pytest.approx(0.5, abs=1e-5)
    assert perspective_loss(-perfect, targets) > 10


def test_the_detector_undoes_the_augmentation_of_the_ground_plane() -> None:
    """The same images and boxes under another BEV augmentation are told the same."""
    model = detector(config=replace(CONFIG, perspective_weight=2.0)).train()
    plain = batch(sample(0, ring_rig(3)), sample(1, ring_rig(2)))
    turned = torch.tensor([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1.0]]).expand(2, 3, 3)
    moved = replace(
        plain, bev_from_ego=turned, boxes=tuple(transform_boxes(b, turned[0].double().numpy()) for b in plain.boxes)
    )
    loss = [float(model.losses(b)["perspective"].detach()) for b in (plain, moved)]
    assert loss[0] > 0 and loss[1] == pytest.approx(loss[0], rel=1e-4)


def test_off_unless_asked_for() -> None:
    model = detector().train()
    assert "perspective" not in model.losses(batch(sample(0, ring_rig(2))))
    assert not any(name.startswith("perspective") for name in model.state_dict())
