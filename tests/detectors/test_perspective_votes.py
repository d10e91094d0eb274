"""Cells of a perspective head vote: what comes back are the objects, also those whose centre is hidden."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from coin3d.augmentation import transform_boxes
from coin3d.detectors import Batch
from coin3d.detectors.perspective import lift_perspective, perspective_targets
from coin3d.detectors.perspective_votes import perspective_boxes, voting_weights
from coin3d.geometry import Boxes3D
from small_world import batch, ring_rig, sample

STRIDE = 8
TURNED = torch.tensor([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1.0]])


def cars(*places: tuple[float, float, float]) -> Boxes3D:
    """Cars at (x, y) with a yaw."""
    return Boxes3D.create(
        [(x, y, 0.8) for x, y, _ in places],
        [(4.2, 1.8, 1.6)] * len(places),
        [yaw for _, _, yaw in places],
        ["car"] * len(places),
    )


def seen(boxes: Boxes3D, batch_: Batch) -> torch.Tensor:
    """What a perfect perspective head would say; cover as logits."""
    targets = perspective_targets([boxes] * len(batch_.cameras), batch_.cameras, STRIDE)
    return torch.cat([20 * (targets.cover[:, None] - 0.5), targets.values], dim=1)


def distances_m(found: torch.Tensor, wanted: Boxes3D) -> np.ndarray:
    """(P, N) on the ground."""
    return np.hypot(*(found[:, None, :2].detach().numpy() - wanted.centre_m[None, :, :2]).transpose(2, 0, 1))


def test_votes_meet_at_the_objects_in_the_augmented_frame() -> None:
    here = replace(batch(sample(0, ring_rig(4))), bev_from_ego=TURNED[None])
    boxes = cars((9.0, 1.0, 0.4), (-1.0, -12.0, -2.0))
    shown = seen(boxes, here)
    feature = torch.ones(len(shown), 3, *shown.shape[-2:], requires_grad=True)
    found = perspective_boxes(shown, torch.full_like(shown[:, 0], 0.9), feature, here, STRIDE, 40, classes=2)
    assert found.code.shape == (1, 40, 10) and found.score.shape == (1, 40, 2) and found.feature.shape == (1, 40, 3)
    score = found.score[0, :, 0]
    assert (score.diff() <= 0).all() and torch.equal(found.score[..., 0], found.score[..., 1])
    wanted = transform_boxes(boxes, TURNED.double().numpy())
    assert (score > 0.3).sum() == 2  # one place each
    sure = found.code[0][:2]
    nearest = distances_m(sure, wanted)
    assert nearest.min(1).max() < 0.01 and set(nearest.argmin(1)) == {0, 1}
    yaw = torch.atan2(sure[:, 6], sure[:, 7]).numpy()
    np.testing.assert_allclose(np.cos(yaw - wanted.yaw_rad[nearest.argmin(1)]), 1, atol=1e-4)
    torch.testing.assert_close(found.feature[0, :2], torch.ones(2, 3))
    found.feature[0, :2].sum().backward()
    assert feature.grad is not None and feature.grad.sum() > 1


def test_an_object_behind_another_has_a_place_of_its_own() -> None:
    here = batch(sample(0, ring_rig(4)))
    boxes = cars((9.0, 0.4, 1.5), (15.0, 5.0, 1.5))  # the first hides the centre of the second
    shown = seen(boxes, here)
    feature = shown[:, :1]
    places, _ = lift_perspective(shown, here.cameras, STRIDE)
    own = torch.hypot(places[:, 0] - 15.0, places[:, 1] - 5.0) < 0.5
    assert own.any() and shown[:, 1:3].norm(dim=1)[own].min() > 0.25  # no cell of the second is that of its centre
    found = perspective_boxes(shown, torch.ones_like(shown[:, 0]), feature, here, STRIDE, 10, classes=1)
    assert distances_m(found.code[0, :2], boxes).min(0).max() < 0.05


def test_scattered_votes_meet_in_the_middle_and_strays_fall_back() -> None:
    torch.manual_seed(0)
    here = batch(sample(0, ring_rig(4)))
    boxes = cars((9.0, 1.0, 0.4))
    shown = seen(boxes, here)
    exact = perspective_boxes(shown, torch.ones_like(shown[:, 0]), shown[:, :1], here, STRIDE, 5, classes=1)
    shown[:, 3] += 0.1 * torch.randn_like(shown[:, 3])  # distances off by a twentieth
    scattered = perspective_boxes(shown, torch.ones_like(shown[:, 0]), shown[:, :1], here, STRIDE, 5, classes=1)
    places, _ = lift_perspective(shown, here.cameras, STRIDE)
    single_m = np.hypot(places[:, 0].numpy() - 9.0, places[:, 1].numpy() - 1.0)
    typical_m = float(single_m[shown[:, 0].numpy() > 0].mean())
    assert distances_m(scattered.code[0, :1], boxes).max() < typical_m / 2
    assert scattered.score[0, 0] < exact.score[0, 0]
    assert (scattered.score[0, 1:] < 0.5 * scattered.score[0, 0]).all()


def test_samples_with_few_cells_repeat_their_last_place() -> None:
    here = batch(sample(0, ring_rig(4)))
    shown = seen(cars((9.0, 1.0, 0.4)), here)[..., :2, :3]
    found = perspective_boxes(shown, torch.ones_like(shown[:, 0]), shown[:, :1], here, STRIDE, 30, classes=1)
    assert found.code.shape == (1, 30, 10)
    torch.testing.assert_close(found.code[0, 24:], found.code[0, 23:24].expand(6, -1))


def test_far_cells_count_less() -> None:
    shown = torch.zeros(1, 6, 1, 3)
    shown[0, 0] = 100.0
    shown[0, 1, 0] = torch.tensor([0.0, 1.0, 2.0])
    torch.testing.assert_close(voting_weights(shown)[0, 0], torch.exp(torch.tensor([0.0, -0.5, -2.0])))
