"""What each method adds to a detector: channels, hooks, switches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
import torch

from coin3d.augmentation import FocalAugmentation
from coin3d.detectors import Batch, BEVDepth
from coin3d.methods import METHODS, CoIn3D, CoIn3DOptions, Direct, Method
from coin3d.priors import PriorOptions, PriorSet, Projector, prior_maps
from small_world import CONFIG, batch, detector, ring_rig, sample, settled

NO_PRIORS = PriorSet(inverse_focal=False, ground_depth=False, ground_gradient=False, pluecker=False)


@pytest.fixture
def one() -> Batch:
    return batch(sample(0, ring_rig(3)))


def forward(model: BEVDepth, on: Batch) -> dict[str, torch.Tensor]:
    with torch.no_grad():
        outputs: dict[str, torch.Tensor] = model(on)
    return outputs


def test_the_table_builds_what_it_names() -> None:
    assert list(METHODS) == ["none", "direct", "coin3d"]
    for kind, make in METHODS.values():
        made = make(kind())
        assert isinstance(made, Method)
    assert type(METHODS["none"][1](METHODS["none"][0]())) is Method


@pytest.mark.parametrize(
    ("priors", "channels"),
    [
        (PriorSet(), 9),
        (PriorSet(inverse_focal=False), 8),
        (PriorSet(ground_depth=False), 8),
        (PriorSet(ground_gradient=False), 8),
        (PriorSet(pluecker=False), 3),
        (PriorSet(inverse_focal=True, ground_depth=False, ground_gradient=False, pluecker=False), 1),
        (NO_PRIORS, 0),
    ],
)
@pytest.mark.parametrize("placement", ["released", "paper"])
def test_channels_of_every_switch(priors: PriorSet, channels: int, placement: str, one: Batch) -> None:
    model = detector("coin3d", CoIn3DOptions(placement=placement, priors=priors)).eval()
    assert model.backbone.trunk.conv1.in_channels == 3 + channels
    at_backbone = channels if placement == "released" else 0
    assert [conv.in_channels for conv in model.neck.lateral_convs] == [128 + at_backbone, 256 + at_backbone]
    assert model.depth_net.reduce_conv[0].in_channels == CONFIG.neck_channels + channels
    levels = {"backbone_8", "backbone_16", "neck"} if placement == "released" else {"neck"}
    assert set(model.method.modulations) == levels
    assert torch.isfinite(forward(model, one)["heatmap"]).all()


@pytest.mark.parametrize("projector", get_args(Projector))
def test_projectors_keep_the_shape(projector: Projector, one: Batch) -> None:
    model = detector("coin3d", CoIn3DOptions(projector=projector)).eval()
    kernels = {"conv1": [1], "conv1+conv1": [1, 1], "conv3": [3], "conv3+conv3": [3, 3]}[projector]
    weights = [p for name, p in model.method.modulations["neck"].named_parameters()]
    assert [tuple(w.shape[-2:]) for w in weights] == [(k, k) for k in kernels]
    assert weights[0].shape[:2] == (CONFIG.neck_channels, 8)
    assert torch.isfinite(forward(model, one)["heatmap"]).all()


def test_concatenation_alone_has_no_projector() -> None:
    model = detector("coin3d", CoIn3DOptions(modulate=False))
    assert not list(model.method.parameters())
    assert model.depth_net.reduce_conv[0].in_channels == CONFIG.neck_channels + 9


def test_the_image_is_followed_by_the_maps_in_use(one: Batch) -> None:
    for priors in (PriorSet(), PriorSet(ground_depth=False), NO_PRIORS):
        method = CoIn3D(CoIn3DOptions(priors=priors))
        made = method.image(one.images, method.prepare(one.cameras))
        assert made.shape[1] == 3 + method.extra_image_channels
        assert torch.equal(made[:, :3], one.images)
        assert torch.equal(made[:, 3:], prior_maps(one.cameras)[:, list(priors.channels)])


@pytest.mark.parametrize("modulate", [True, False])
def test_with_everything_off_it_is_the_plain_detector(one: Batch, modulate: bool) -> None:
    plain = settled(detector("none", seed=3), one)
    off = detector("coin3d", CoIn3DOptions(priors=NO_PRIORS, modulate=modulate), seed=4).eval()
    assert list(off.state_dict()) == list(plain.state_dict())
    off.load_state_dict(plain.state_dict())
    for name, value in forward(off, one).items():
        assert torch.equal(value, forward(plain, one)[name])


def test_a_silent_prior_slice_is_the_plain_detector(one: Batch) -> None:
    """Concatenated priors with zero weights, at a focal length whose inverse focal map is 1: nothing changes."""
    plain = settled(detector("none", seed=3), one)
    focal_px = float(one.cameras.focal_px[0])
    method = detector("coin3d", CoIn3DOptions(maps=PriorOptions(reference_focal_px=focal_px))).eval()
    weights = {name: torch.zeros_like(value) for name, value in method.state_dict().items()}
    for name, value in plain.state_dict().items():
        weights[name][tuple(slice(n) for n in value.shape)] = value
    method.load_state_dict(weights)
    found, expected = forward(method, one), forward(plain, one)
    for name in expected:
        torch.testing.assert_close(found[name], expected[name], rtol=1e-3, atol=1e-3)


def test_inverse_focal_scales_the_features(one: Batch) -> None:
    """Twice the focal length: a quarter of the feature (paper eq. M_invF)."""
    method = CoIn3D(CoIn3DOptions(priors=replace(NO_PRIORS, inverse_focal=True)))
    method.attach("neck", 5, 16)
    features = torch.randn(3, 5, 4, 6)
    near = method.modulate("neck", features, one.cameras)
    far = method.modulate("neck", features, batch(sample(0, ring_rig(3, focal_px=120.0))).cameras)
    torch.testing.assert_close(far[:, :5], near[:, :5] / 4)
    assert torch.equal(method.modulate("elsewhere", features, one.cameras), features)


def test_focal_augmentation_is_a_switch() -> None:
    zoom = FocalAugmentation(0.9, 1.1)
    assert CoIn3D(CoIn3DOptions(focal=zoom)).view_augmentation == zoom
    assert CoIn3D(CoIn3DOptions(focal_augmentation=False)).view_augmentation is None
    assert Method().view_augmentation is None and Direct().view_augmentation is None


def test_training_keeps_maps_of_one_batch_only(one: Batch) -> None:
    method = CoIn3D().train()
    for cameras in (2, 3, 4):
        context = method.prepare(batch(sample(0, ring_rig(cameras))).cameras)
        method.image(torch.zeros(cameras, 3, 64, 96), context)
    assert len(method._priors) == 1
    method.eval()
    for cameras in (2, 3):
        method.image(torch.zeros(cameras, 3, 64, 96), method.prepare(batch(sample(0, ring_rig(cameras))).cameras))
    assert len(method._priors) == 3


def test_camera_vector_by_hand() -> None:
    turned = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1.1]])
    both = batch(sample(0, ring_rig(1)), sample(1, ring_rig(2), bev_from_ego=turned))
    vector = Direct().camera_vector(both.cameras, both.bev_from_ego[both.sample_index], None)
    assert vector.shape == (3, Direct().camera_vector_channels) == (3, 23)
    intrinsics = [60, 0, 48.7, 0, 60, 30.7]
    # the first camera looks forward: its right is -y, its down -z, and it sits at (1, 0, 1.6)
    mounting = [0, 0, 1, 1, -1, 0, 0, 0, 0, -1, 0, 1.6]
    np.testing.assert_allclose(vector[0], [*intrinsics, 1, 0, 0, 1, 1, *mounting], atol=1e-6)
    np.testing.assert_allclose(vector[1], [*intrinsics, 0.6, -0.8, 0.8, 0.6, 1.1, *mounting], atol=1e-6)


@pytest.mark.parametrize(
    ("make", "gates"), [(lambda: Method(), 0), (lambda: CoIn3D(), 0), (lambda: Direct(), 2)], ids=["none", "coin3d", "direct"]
)
def test_only_direct_transfer_has_camera_gates(make: Callable[[], Method], gates: int) -> None:
    names = {name.split(".")[0] for name, _ in BEVDepth(CONFIG, ("car",), make()).depth_net.named_modules()}
    assert len(names & {"depth_gate", "context_gate"}) == gates
