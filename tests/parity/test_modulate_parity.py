"""The three modulation layers of the released detector, with weights generated from their names."""

from __future__ import annotations

import pytest
import torch
from parity_files import filler, fixture
from torch import nn

from coin3d.priors import SpatialModulation


@pytest.mark.parametrize(
    ("place", "channels", "height", "width"),
    [("backbone_16x", 1024, 8, 22), ("backbone_32x", 2048, 4, 11), ("neck", 512, 8, 22)],
)
def test_modulation(place: str, channels: int, height: int, width: int) -> None:
    generated, stored = filler(), fixture("coin3d_modulate.npz")
    layer = SpatialModulation(channels).eval()
    generated.fill(
        nn.ModuleDict({f"prior_modulate_layer_{place}": layer}),
        canon=lambda name: name.replace("projector", "perspective_modulate_conv"),
        gain=generated.COIN3D_GAIN,
    )
    features = generated.randn(f"coin3d_mod_feat_{place}", 2, channels, height, width)
    prior = generated.randn(f"coin3d_mod_prior_{place}", 2, 9, height, width)
    with torch.inference_mode():
        out = layer(features, prior)
    expected = torch.from_numpy(stored[f"out_{place}"])
    error = (out[:, ::8] - expected).abs().max() / expected.abs().max()
    assert out[:, ::8].shape == expected.shape
    assert error < 2e-5
    assert torch.equal(out[:, -9:], torch.from_numpy(stored[f"tail_{place}"]))
