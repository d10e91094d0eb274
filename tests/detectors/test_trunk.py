"""Pre-training of a trunk: what it learns from, which trunks it fits, and that detectors start from it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from coin3d.detectors import DETECTORS, BEVDepthConfig, PETRConfig, TrunkConfig, TrunkPretraining
from coin3d.detectors.method import Method
from coin3d.training.checkpoint import describe, load_checkpoint, load_trunk, save_checkpoint
from small_world import CLASSES, CONFIG, batch, detector, ring_rig, sample

TRUNK = replace(TrunkConfig.of(CONFIG), channels=16, strides=(8, 16))


def trunk(seed: int = 0) -> TrunkPretraining:
    torch.manual_seed(seed)
    return TrunkPretraining(TRUNK, CLASSES, Method())


def saved(model: TrunkPretraining, path: Path) -> Path:
    save_checkpoint(path, model.state_dict(), describe("trunk", TRUNK, CLASSES, "none", {}))
    return path


def test_losses_reach_every_weight_and_fall() -> None:
    model, one = trunk(), batch(sample(0, ring_rig(2)), sample(1, ring_rig(3)))
    optimizer = torch.optim.AdamW(model.parameters(), 2e-3)
    totals = []
    for _ in range(12):
        losses = model.losses(one)
        total = torch.stack(list(losses.values())).sum()
        optimizer.zero_grad()
        total.backward()
        assert all(p.grad is not None and torch.isfinite(p.grad).all() for p in model.parameters())
        optimizer.step()
        totals.append(float(total.detach()))
    assert set(losses) == {"depth", "perspective"}
    assert totals[-1] < 0.7 * totals[0]


def test_a_longer_lens_is_the_same_to_it() -> None:
    """Twice the focal length at twice the distance gives the same image: the same depth is asked for."""
    model = trunk().eval()
    near = batch(sample(0, ring_rig(1)))
    assert near.depth_m is not None
    K = near.cameras.K.clone()
    K[:, :2, :2] *= 2
    far = replace(near, cameras=replace(near.cameras, K=K), depth_m=near.depth_m * 2)
    other = replace(near, depth_m=near.depth_m * 2)
    depth = [float(model.losses(b)["depth"]) for b in (near, far, other)]
    assert depth[0] == pytest.approx(depth[1], rel=1e-5) and depth[0] != pytest.approx(depth[2], rel=1e-3)


def test_a_detector_starts_from_it(tmp_path: Path) -> None:
    model = detector()
    head = model.head.shared_conv[0].weight.clone()
    load_trunk(model, saved(other := trunk(seed=5), tmp_path / "trunk.safetensors"))
    for name, tensor in other.backbone.state_dict().items():
        assert torch.equal(model.backbone.state_dict()[name], tensor), name
    assert torch.equal(model.head.shared_conv[0].weight, head)


def test_a_trunk_of_another_shape_is_refused(tmp_path: Path) -> None:
    path = saved(trunk(), tmp_path / "trunk.safetensors")
    wide = detector(config=replace(CONFIG, strides=(16, 32)))
    with pytest.raises(ValueError, match=r"does not fit: this detector needs 'backbone\.trunk\.layer4.*coin3d pretrain"):
        load_trunk(wide, path)


def test_it_is_no_detector(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="a pre-trained trunk, which detects nothing; give it to coin3d train --trunk"):
        load_checkpoint(saved(trunk(), tmp_path / "trunk.safetensors"))
    with pytest.raises(ValueError, match="--trunk"):
        trunk().detect(batch(sample(0, ring_rig(1))))
    with pytest.raises(ValueError, match="lacks one of them"):
        trunk().losses(replace(batch(sample(0, ring_rig(2))), depth_m=None))


def test_presets_tiny_share_a_trunk() -> None:
    tiny = {TrunkConfig.of(kind.tiny()) for kind, _ in DETECTORS.values()}
    assert len(tiny) == 1
    assert TrunkConfig.of(BEVDepthConfig.paper()).strides == (8, 16, 32)
    with pytest.raises(ValueError, match="this detector has v2-99"):
        TrunkConfig.of(PETRConfig.paper())
