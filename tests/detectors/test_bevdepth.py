"""The whole detector at its smallest: every method runs, rigs may be mixed, and it can learn a frame by heart."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Literal

import numpy as np
import pytest
import torch

from coin3d.detectors import Batch, BEVDepth, BEVDepthConfig, collate
from coin3d.detectors.center_head import REGRESSIONS
from coin3d.methods import METHODS
from small_world import CLASSES, CONFIG, batch, detector, ring_rig, sample, settled


@cache
def model(method: str) -> BEVDepth:
    """One detector for all tests that do not change it."""
    return settled(detector(method), batch(sample(7, ring_rig(4)), sample(8, ring_rig(4, focal_px=80.0, height_m=2.0))))


def run(method: str, batch_: Batch) -> dict[str, torch.Tensor]:
    with torch.no_grad():
        outputs: dict[str, torch.Tensor] = model(method)(batch_)
    return outputs


@pytest.mark.parametrize("method", list(METHODS))
def test_shapes(method: str) -> None:
    outputs = run(method, batch(sample(0, ring_rig(3)), sample(1, ring_rig(2))))
    expected = {**REGRESSIONS, "heatmap": len(CLASSES)}
    assert {name: tuple(outputs[name].shape) for name in expected} == {n: (2, c, 32, 32) for n, c in expected.items()}
    assert outputs["depth_logits"].shape == (5, CONFIG.bins.count, 8, 12)


@pytest.mark.parametrize("method", list(METHODS))
def test_mixed_rigs_equal_the_samples_alone(method: str) -> None:
    turned = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1.0]])
    samples = [sample(0, ring_rig(3)), sample(1, ring_rig(5, focal_px=90.0, height_m=2.1), bev_from_ego=turned)]
    together = run(method, collate(samples))
    alone = [run(method, collate([s])) for s in samples]
    for name, outputs in together.items():
        expected = torch.cat([a[name] for a in alone])
        torch.testing.assert_close(outputs, expected, rtol=1e-3, atol=1e-3)
    assert (together["heatmap"][0] - together["heatmap"][1]).abs().max() > 0.1


@pytest.mark.parametrize("method", list(METHODS))
def test_order_of_cameras_does_not_matter(method: str) -> None:
    whole = sample(0, ring_rig(4))
    order = [2, 0, 3, 1]
    shuffled = replace(whole, images=whole.images[order], cameras=tuple(whole.cameras[i] for i in order), depth_m=None)
    torch.testing.assert_close(
        run(method, collate([whole]))["heatmap"], run(method, collate([shuffled]))["heatmap"], rtol=1e-3, atol=1e-3
    )


@pytest.mark.parametrize("method", ["direct", "coin3d"])
def test_these_methods_look_at_the_camera(method: str) -> None:
    """The depth of the same pixels depends on the focal length; without a method it cannot."""
    near, far = sample(0, ring_rig(2)), sample(0, ring_rig(2, focal_px=110.0))
    far = replace(far, images=near.images)
    plain = [run("none", collate([s]))["depth_logits"] for s in (near, far)]
    aware = [run(method, collate([s]))["depth_logits"] for s in (near, far)]
    assert torch.equal(*plain)
    assert (aware[0] - aware[1]).abs().max() > 0.1


def test_detections_are_sorted_boxes_in_range() -> None:
    both = batch(sample(0, ring_rig(3)), sample(1, ring_rig(2)))
    found = model("coin3d").detect(both)
    assert len(found) == 2
    for boxes in found:
        assert 0 < len(boxes) <= 50 and set(boxes.labels) <= set(CLASSES)
        assert (np.diff(boxes.scores) <= 0).all()
    again = model("coin3d").detect(both)  # now from the caches
    np.testing.assert_array_equal(found[1].centre_m, again[1].centre_m)


def test_losses_reach_every_weight() -> None:
    """No branch is dead; the gates of the camera vector and the projectors of the priors included."""
    both = batch(sample(0, ring_rig(3)), sample(1, ring_rig(2)))
    for method in METHODS:
        fresh = settled(detector(method), both).train()
        losses = fresh.losses(both)
        assert set(losses) == {*REGRESSIONS, "heatmap", "depth"}
        torch.stack(list(losses.values())).sum().backward()
        unmoved = [name for name, p in fresh.named_parameters() if p.grad is None or not p.grad.any()]
        # a bias in front of batch norm has no effect
        assert [name for name in unmoved if name != "depth_net.reduce_conv.0.bias"] == [], method


def test_batches_that_cannot_be_trained_on_are_refused() -> None:
    fresh, whole = detector().train(), batch(sample(0, ring_rig(2)))
    with pytest.raises(ValueError, match="LiDAR"):
        fresh.losses(replace(whole, depth_m=None))
    with pytest.raises(ValueError, match="0 tables of them for 1 samples"):
        fresh.losses(replace(whole, boxes=()))
    with pytest.raises(ValueError, match="two images"):
        fresh.losses(batch(sample(0, ring_rig(1))))


def test_bfloat16_stays_near_float32() -> None:
    both = batch(sample(0, ring_rig(3)))
    exact = {k: float(v.detach()) for k, v in model("coin3d").losses(both).items()}
    with torch.autocast("cpu", dtype=torch.bfloat16):
        rounded = {k: float(v.detach()) for k, v in model("coin3d").losses(both).items()}
    assert rounded == pytest.approx(exact, rel=0.1)


@pytest.mark.parametrize("previous_by", ["pose", "warp"])
def test_the_frame_before_is_placed_exactly_in_bfloat16(previous_by: Literal["pose", "warp"]) -> None:
    config = replace(CONFIG, frames=2, previous_by=previous_by)
    moved = torch.eye(4).repeat(3, 1, 1)
    moved[:, :3, 3] = torch.tensor([-1.37, 0.21, 0.0])
    now, before = batch(sample(0, ring_rig(3))), batch(sample(5, ring_rig(3)))
    both = replace(now, previous=replace(before, key_from_ego=moved))
    exact = both.previous.lift_cameras.ego_from_cam
    looking_back = settled(detector("coin3d", config=config), both)

    def noise(given: Batch) -> float:
        with torch.no_grad():
            expected = looking_back(given)["heatmap"]
            with torch.autocast("cpu", dtype=torch.bfloat16):
                assert given.previous is None or torch.equal(given.previous.lift_cameras.ego_from_cam, exact)
                return float((looking_back(given)["heatmap"].float() - expected).abs().mean())

    assert noise(both) < 2 * noise(now)  # each frame brings that of one


@pytest.mark.parametrize("preset", [BEVDepthConfig.tiny, BEVDepthConfig.small, BEVDepthConfig.paper])
def test_presets_are_consistent(preset: type) -> None:
    with torch.device("meta"):
        built = detector("coin3d", config=preset())
    assert sum(p.numel() for p in built.parameters()) > 1e6


@pytest.mark.parametrize("method", ["none", "coin3d"])
def test_one_frame_is_learned_by_heart(method: str) -> None:
    one = batch(sample(3, ring_rig(3)))
    learner = detector(method).train()
    optimizer = torch.optim.AdamW(learner.parameters(), lr=3e-3)
    totals = []
    for _ in range(30):
        total = torch.stack(list(learner.losses(one).values())).sum()
        optimizer.zero_grad()
        total.backward()
        torch.nn.utils.clip_grad_norm_(learner.parameters(), 5.0)
        optimizer.step()
        totals.append(float(total.detach()))
    assert np.mean(totals[-3:]) < 0.5 * totals[0], totals
