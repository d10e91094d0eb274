"""Megvii's variant of BEVDepth at its smallest: it runs, learns, refuses what it cannot be, and keeps its conventions."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch

from coin3d.detectors import Batch, BEVDepth, BEVDepthConfig
from coin3d.detectors.bevdepth_config import MegviiVariant
from coin3d.detectors.released_image import swapped
from coin3d.detectors.task_decode import TaskDecodeOptions
from coin3d.detectors.task_heads import TASK_REGRESSIONS
from coin3d.methods import METHODS, DirectOptions
from coin3d.methods.released_camera_numbers import ReleasedCameraNumbers
from coin3d.priors.released import ReleasedConventions
from coin3d.records import from_plain, to_plain
from small_world import CLASSES, CONFIG, batch, detector, ring_rig, sample, settled

SMALL = replace(
    CONFIG,
    strides=(4, 8, 16, 32),
    frames=2,
    megvii=MegviiVariant((("car",), ("pedestrian",)), decode=TaskDecodeOptions((4.0, 0.175), min_score=0.0, max_kept=20)),
    released=ReleasedConventions(swapped_images=True),
)


def fresh(depth_aggregation: bool = True) -> BEVDepth:
    assert SMALL.megvii is not None
    config = replace(SMALL, megvii=replace(SMALL.megvii, depth_aggregation=depth_aggregation))
    return detector("direct", DirectOptions(released=ReleasedCameraNumbers()), config=config)


@cache
def two_frames() -> Batch:
    now, before = (batch(sample(s, ring_rig(3)), sample(s + 1, ring_rig(2, focal_px=80.0))) for s in (0, 5))
    moved = torch.eye(4).repeat(5, 1, 1)
    moved[:, 0, 3] = -1.0
    # the small world's boxes stand still for all anyone knows, and an unknown velocity teaches nothing
    boxes = tuple(replace(table, velocity_mps=np.full((len(table), 2), 1.5)) for table in now.boxes)
    return replace(now, boxes=boxes, previous=replace(before, key_from_ego=moved))


@cache
def model() -> BEVDepth:
    return settled(fresh(), two_frames())


def test_boxes_with_velocities() -> None:
    found = model().detect(two_frames())
    assert len(found) == 2
    for boxes in found:
        assert 0 < len(boxes) <= 40 and set(boxes.labels) <= set(CLASSES)
        assert np.isfinite(boxes.velocity_mps).all() and (np.diff(boxes.scores) <= 0).all()


@pytest.mark.parametrize("depth_aggregation", [True, False])
def test_losses_reach_every_weight(depth_aggregation: bool) -> None:
    learner = settled(fresh(depth_aggregation), two_frames()).train()
    losses = learner.losses(two_frames())
    assert set(losses) == {*TASK_REGRESSIONS, "heatmap", "depth"}
    torch.stack(list(losses.values())).sum().backward()
    unmoved = [name for name, p in learner.named_parameters() if p.grad is None or not p.grad.any()]
    assert [name for name in unmoved if name != "depth_net.reduce_conv.0.bias"] == []


def test_without_a_frame_before_this_one_stands_in() -> None:
    alone = replace(two_frames(), previous=None)
    with torch.no_grad():
        once, twice = model()(alone), model()(replace(alone, previous=alone))
        moved = model()(two_frames())
    torch.testing.assert_close(once["heatmap"], twice["heatmap"])
    assert (once["heatmap"] - moved["heatmap"]).abs().max() > 0.1


def test_the_frame_before_is_gated_by_the_cameras_of_this_one() -> None:
    """As released; where it is lifted to depends on its own cameras all the same."""
    seen = []
    hook = model().depth_net.vector_norm.register_forward_hook(lambda _m, inputs, _o: seen.append(inputs[0]))
    both, before = two_frames(), two_frames().previous
    assert before is not None
    other = replace(both, previous=replace(before, cameras=replace(before.cameras, K=before.cameras.K * 1.1)))
    with torch.no_grad():
        model()(other)
    hook.remove()
    assert len(seen) == 2 and torch.equal(*seen) and seen[0].shape == (5, 27)
    fewer = batch(sample(5, ring_rig(2)), sample(6, ring_rig(2)))
    with pytest.raises(ValueError, match="same cameras in both frames"):
        model()(replace(both, previous=fewer))


@pytest.mark.parametrize("method", METHODS)
def test_every_method_plugs_in(method: str) -> None:
    plugged = detector(method, config=replace(SMALL, frames=1)).eval()
    with torch.no_grad():
        outputs = plugged(batch(sample(0, ring_rig(2))))
    assert outputs["heatmap"].shape == (1, 2, 32, 32) and outputs["velocity"].shape == (1, 4, 32, 32)


def test_images_are_turned_as_released() -> None:
    red = torch.tensor([1.0, 0.485, 0.456]).reshape(1, 3, 1, 1).expand(1, 3, 2, 2)
    statistics = torch.tensor([[0.485, 0.456, 0.406], [0.229, 0.224, 0.225]])[:, :, None, None]
    turned = swapped((red - statistics[0]) / statistics[1])
    # blue 0.456 less the mean of red, green 0.485 less that of green, red 1 less that of blue
    expected = [(0.456 - 0.485) / 0.229, (0.485 - 0.456) / 0.224, (1 - 0.406) / 0.225]
    np.testing.assert_allclose(turned[0, :, 1, 1].numpy(), expected, rtol=1e-4)
    images = torch.randn(2, 3, 4, 4)
    torch.testing.assert_close(swapped(swapped(images)), images)


def test_configurations() -> None:
    config = BEVDepthConfig.released_megvii(depth_aggregation=True)
    assert from_plain(BEVDepthConfig, to_plain(config)) == config
    assert (config.bins.count, config.feature_stride, config.image_width_px, config.image_height_px) == (112, 16, 704, 256)
    assert BEVDepthConfig().feature_stride == 16 and BEVDepthConfig.tiny().feature_stride == 8
    with pytest.raises(ValueError, match="previous_by"):
        replace(config, previous_by="warp")
    with pytest.raises(ValueError, match="2 tasks with 6 distances"):
        MegviiVariant((("car",), ("pedestrian",)))
    with pytest.raises(ValueError, match="the classes of this head's tasks are car, truck"):
        detector(config=config)


def test_frames_without_boxes_and_images_that_are_no_numbers() -> None:
    both = two_frames()
    empty = replace(both, boxes=tuple(boxes[np.zeros(len(boxes), dtype=bool)] for boxes in both.boxes))
    assert all(loss.isfinite() for loss in model().losses(empty).values())
    broken = both.images.clone()
    broken[:, :, 20:30] = torch.nan
    assert [len(boxes) for boxes in model().detect(replace(both, images=broken))] == [0, 0]
