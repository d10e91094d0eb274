"""Sampling of feature maps at learned places, against the definition of bilinear interpolation."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from coin3d.detectors.deformable_attention import SamplingPlan, sample_values

SIZES = ((5, 7), (3, 4))


def reference(levels: list[np.ndarray], locations: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The same sums with float64 loops: every sample is shared out over the four cells around it."""
    n, q, heads, _, points, _ = locations.shape
    width = levels[0].shape[1] // heads
    out = np.zeros((n, q, heads, width))
    for index in np.ndindex(n, q, heads, len(levels), points):
        b, query, head, level, _ = index
        features = levels[level][b, head * width : (head + 1) * width]
        rows, columns = features.shape[1:]
        x, y = locations[index] * (columns, rows) - 0.5  # the centre of cell 0 is half a cell from the edge
        left, top = int(np.floor(x)), int(np.floor(y))
        for row, column in ((top, left), (top, left + 1), (top + 1, left), (top + 1, left + 1)):
            if 0 <= row < rows and 0 <= column < columns:
                share = (1 - abs(x - column)) * (1 - abs(y - row))
                out[b, query, head] += weights[index] * share * features[:, row, column]
    return out.reshape(n, q, -1)


def case(seed: int = 0) -> tuple[list[Tensor], Tensor, Tensor]:
    """Two samples, three queries, two heads of three channels, four points a level; some of them outside."""
    generator = torch.Generator().manual_seed(seed)
    draw = {"generator": generator, "dtype": torch.float64}
    levels = [torch.randn(2, 6, *size, **draw) for size in SIZES]
    locations = torch.rand(2, 3, 2, 2, 4, 2, **draw) * 1.4 - 0.2
    return levels, locations, torch.rand(2, 3, 2, 2, 4, **draw)


@pytest.mark.parametrize("seed", range(3))
def test_sums_are_bilinear(seed: int) -> None:
    levels, locations, weights = case(seed)
    expected = reference([x.numpy() for x in levels], locations.numpy(), weights.numpy())
    np.testing.assert_allclose(sample_values(levels, locations, weights).numpy(), expected, atol=1e-12)


def test_cell_centres_are_read_exactly() -> None:
    levels, _, _ = case()
    locations = torch.zeros(2, 1, 2, 1, 1, 2, dtype=torch.float64)
    locations[..., 0], locations[..., 1] = 2.5 / 7, 1.5 / 5
    read = sample_values(levels[:1], locations, torch.ones(2, 1, 2, 1, 1, dtype=torch.float64))
    torch.testing.assert_close(read[:, 0], levels[0][:, :, 1, 2])


def test_gradients() -> None:
    levels, locations, weights = case()
    inputs = [x.requires_grad_() for x in (*levels, locations, weights)]
    assert torch.autograd.gradcheck(lambda a, b, where, w: sample_values([a, b], where, w), inputs)


def test_no_level_is_an_error() -> None:
    with pytest.raises(ValueError, match="feature map"):
        sample_values([], torch.zeros(1, 1, 1, 0, 1, 2), torch.zeros(1, 1, 1, 0, 1))


def test_a_fresh_plan_looks_around_evenly() -> None:
    offsets, weights = SamplingPlan(8, heads=4, maps=2, points=3)(torch.randn(2, 5, 8))
    assert offsets.shape == (2, 5, 4, 2, 3, 2)
    torch.testing.assert_close(weights, torch.full((2, 5, 4, 2, 3), 1 / 3))
    torch.testing.assert_close(offsets[0, 0, :, 1, 2], torch.tensor([[3.0, 0], [0, 3], [-3, 0], [0, -3]]), atol=1e-5, rtol=0)
