"""V2-99: shapes without numbers, and one block by hand."""

from __future__ import annotations

import pytest
import torch

from coin3d.detectors.vovnet import AggregationBlock, VoVNet99


def test_levels_and_size() -> None:
    with torch.device("meta"):
        trunk = VoVNet99()
        features = trunk(torch.zeros(2, 3, 96, 160))
    assert [tuple(x.shape) for x in features] == [(2, 768, 6, 10), (2, 1024, 3, 5)]
    assert trunk.channels == [768, 1024]
    assert sum(p.numel() for p in trunk.parameters()) == pytest.approx(69.5e6, rel=0.01)


def test_levels_that_are_not_asked_for_are_not_built() -> None:
    with torch.device("meta"):
        trunk = VoVNet99((4, 8), extra_channels=9)
        features = trunk(torch.zeros(1, 12, 64, 64))
    assert [tuple(x.shape) for x in features] == [(1, 256, 16, 16), (1, 512, 8, 8)]
    assert len(trunk.stages) == 2


@pytest.mark.parametrize("strides", [(), (2, 4), (32, 16)])
def test_other_levels_are_refused(strides: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="rising strides"):
        VoVNet99(strides)


@pytest.mark.parametrize("residual", [False, True])
def test_block(residual: bool) -> None:
    """Every layer passes its input on, so the join sees six times the same; the gate lets half of the channel through."""
    block = AggregationBlock(1, 1, 1, residual).eval()
    for layer in (*block.layers, block.join):
        torch.nn.init.zeros_(layer[0].weight)
        layer[0].weight.data[..., layer[0].kernel_size[0] // 2, layer[0].kernel_size[1] // 2] = 1.0
        layer[1].eps = 0.0
    torch.nn.init.zeros_(block.gate.weight)
    torch.nn.init.zeros_(block.gate.bias)
    x = torch.tensor([[[[1.0, 2.0], [3.0, 4.0]]]])
    torch.testing.assert_close(block(x), (3.0 + residual) * x)
