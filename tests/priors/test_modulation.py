"""The modulation layer: what each switch does to the numbers."""

from __future__ import annotations

from typing import cast, get_args

import pytest
import torch

from coin3d.priors import PriorSet, Projector, SpatialModulation
from coin3d.priors.channels import GROUND_DEPTH, INVERSE_FOCAL

FEATURES = torch.randn(2, 4, 3, 5, generator=torch.Generator().manual_seed(0))
PRIOR = torch.randn(2, 9, 3, 5, generator=torch.Generator().manual_seed(1))


def test_paper_equation_with_a_centre_tap_projector() -> None:
    layer = SpatialModulation(4)
    weight = torch.zeros(4, 8, 3, 3)
    weight[2, GROUND_DEPTH - 1, 1, 1] = 1.5  # output channel 2 sees 1.5 times the ground depth, rectified
    layer.load_state_dict({"projector.0.weight": weight})
    out = layer(FEATURES, PRIOR)
    expected = FEATURES * PRIOR[:, :1]
    expected[:, 2] += (1.5 * PRIOR[:, GROUND_DEPTH]).relu()
    torch.testing.assert_close(out, torch.cat([expected, PRIOR], dim=1))


@pytest.mark.parametrize(
    ("priors", "channels"),
    [
        (PriorSet(), tuple(range(9))),
        (PriorSet(inverse_focal=False), tuple(range(1, 9))),
        (PriorSet(ground_depth=False), (0, 2, 3, 4, 5, 6, 7, 8)),
        (PriorSet(ground_gradient=False, pluecker=False), (0, 1)),
        (PriorSet(True, False, False, False), (0,)),
        (PriorSet(False, False, False, False), ()),
    ],
)
def test_priors_that_are_off_do_not_matter(priors: PriorSet, channels: tuple[int, ...]) -> None:
    assert priors.channels == channels
    layer = SpatialModulation(4, priors)
    out = layer(FEATURES, PRIOR)
    assert out.shape == (2, layer.out_channels, 3, 5) == (2, 4 + len(channels), 3, 5)
    changed = PRIOR.clone()
    unused = [c for c in range(9) if c not in channels]
    changed[:, unused] += 10
    assert torch.equal(layer(FEATURES, changed), out)
    for channel in channels:
        changed = PRIOR.clone()
        changed[:, channel] += 10
        assert not torch.equal(layer(FEATURES, changed)[:, :4], out[:, :4]), f"channel {channel} is not used"


def test_without_inverse_focal_features_are_not_scaled() -> None:
    layer = SpatialModulation(4, PriorSet(inverse_focal=False))
    prior = PRIOR.clone()
    prior[:, 1:] = 0  # projector without bias: nothing to add
    assert torch.equal(layer(FEATURES, prior)[:, :4], FEATURES)


def test_concatenation_only() -> None:
    layer = SpatialModulation(4, modulate=False)
    assert torch.equal(layer(FEATURES, PRIOR), torch.cat([FEATURES, PRIOR], dim=1))
    assert not list(layer.parameters())


@pytest.mark.parametrize(
    ("projector", "shapes"),
    [
        ("conv1", [(4, 8, 1, 1)]),
        ("conv1+conv1", [(4, 8, 1, 1), (4, 4, 1, 1)]),
        ("conv3", [(4, 8, 3, 3)]),
        ("conv3+conv3", [(4, 8, 3, 3), (4, 4, 3, 3)]),
    ],
)
def test_projector_variants(projector: Projector, shapes: list[tuple[int, ...]]) -> None:
    layer = SpatialModulation(4, projector=projector)
    assert [tuple(p.shape) for p in layer.parameters()] == shapes
    added = layer(FEATURES, PRIOR)[:, :4] - FEATURES * PRIOR[:, INVERSE_FOCAL : INVERSE_FOCAL + 1]
    assert added.min() >= -1e-6 and added.max() > 0  # rectified


def test_unknown_projector() -> None:
    assert set(get_args(Projector)) == {"conv1", "conv1+conv1", "conv3", "conv3+conv3"}
    with pytest.raises(ValueError, match="projector is one of"):
        SpatialModulation(4, projector=cast(Projector, "conv5"))


def test_gradients_reach_features_and_projector() -> None:
    layer, features = SpatialModulation(4), FEATURES.clone().requires_grad_()
    layer(features, PRIOR).square().sum().backward()
    assert features.grad is not None and features.grad.abs().sum() > 0
    assert all(p.grad is not None and p.grad.abs().sum() > 0 for p in layer.parameters())
