"""Distances as distributions: what is read off, and what is learned."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from coin3d.detectors.perspective import PerspectiveTargets, scaled_log_distance
from coin3d.detectors.perspective_bins import BinnedPerspectiveHead


def head() -> BinnedPerspectiveHead:
    torch.manual_seed(0)
    return BinnedPerspectiveHead(4, 8)


def with_bins(of_bins: torch.Tensor) -> torch.Tensor:
    raw = torch.arange(45, dtype=torch.float32)[None, :, None, None].clone()
    raw[0, 5:, 0, 0] = of_bins
    return raw


def test_the_bins_are_apparent_distances_of_equal_ratio() -> None:
    metres = 25 * (head().bins / 2).exp()
    np.testing.assert_allclose(metres[[0, -1]], [3, 75], rtol=1e-5)
    np.testing.assert_allclose(metres[1:] / metres[:-1], 25 ** (1 / 39), rtol=1e-5)
    assert [scaled_log_distance(float(m)) for m in metres] == pytest.approx(head().bins.tolist(), abs=1e-5)


def test_between_two_distances_the_likelier_is_read_with_its_neighbours() -> None:
    """0.6 around bins 10 and 11, 0.4 at bin 30: a mean would lie where nothing is."""
    probability = torch.full((40,), 1e-9)
    probability[[10, 11, 30]] = torch.tensor([0.4, 0.2, 0.4 - 1e-6])
    made = head()
    said, sure = made.read(with_bins(probability.log()))
    assert sure[0, 0, 0] == pytest.approx(0.6, abs=1e-4)
    assert said[0, 3, 0, 0] == pytest.approx(float((2 * made.bins[10] + made.bins[11]) / 3), abs=1e-4)
    np.testing.assert_array_equal(said[0, [0, 1, 2, 4, 5], 0, 0], [0, 1, 2, 3, 4])  # cover, offset, heading


def test_the_loss_is_least_at_the_truth() -> None:
    made = head()
    targets = PerspectiveTargets(
        torch.ones(1, 1, 1),
        torch.ones(1, 1, 1, dtype=torch.bool),
        torch.tensor([0.3, -0.2, 0.1, 0.6, 0.8])[None, :, None, None],
    )
    steps = (0.1 - made.bins) / (made.bins[1] - made.bins[0])
    raw = with_bins(-steps.square() / 2)
    raw[0, :5, 0, 0] = torch.tensor([40.0, 0.3, -0.2, 0.6, 0.8])
    best = float(made.loss(raw, targets))
    said, _ = made.read(raw)
    torch.testing.assert_close(said[0, 1:, 0, 0], targets.values[0, :, 0, 0], atol=0.02, rtol=0)
    for channel in (0, 1, 3, 31):  # the last is the bin of the truth
        worse = raw.clone()
        worse[0, channel] -= 45.0 if channel == 0 else 0.7
        assert float(made.loss(worse, targets)) > best + 0.01
    nothing = PerspectiveTargets(torch.zeros(1, 1, 1), torch.zeros(1, 1, 1, dtype=torch.bool), torch.zeros(1, 5, 1, 1))
    raw[0, 0] = -40.0
    assert float(made.loss(raw, nothing)) == pytest.approx(0, abs=1e-5)
