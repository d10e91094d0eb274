"""The orthogonalised momentum: against singular value decompositions and steps worked out by hand."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from coin3d.training.muon import Muon, orthogonalised
from coin3d.training.optimizers import build_optimizers
from coin3d.training.options import TrainOptions


@pytest.mark.parametrize("shape", [(8, 8), (16, 40), (40, 16)])
@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e3])
def test_singular_vectors_stay_and_singular_values_become_about_one(shape: tuple[int, int], scale: float) -> None:
    matrix = torch.randn(shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64) * scale
    u, s, v = torch.linalg.svd(matrix, full_matrices=False)
    turned = u.T @ orthogonalised(matrix) @ v.T
    large = s > 0.05 * s.max()  # directions of almost no gradient may stay small
    values = turned.diagonal()[large]
    assert ((values > 0.6) & (values < 1.3)).all()
    torch.testing.assert_close(turned - torch.diag(turned.diagonal()), torch.zeros_like(turned), atol=1e-6, rtol=0)


@pytest.mark.parametrize("shape", [(16, 144), (144, 16)])
def test_equals_the_iteration_written_out(shape: tuple[int, int]) -> None:
    """Jordan et al.: X <- a X + (b A + c A A) X with A = X X^T, five times, in double precision."""
    matrix = torch.randn(shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64) @ torch.diag(
        torch.logspace(0, -5, shape[1], dtype=torch.float64)
    )
    x = (matrix if shape[0] <= shape[1] else matrix.T) / matrix.norm()
    for _ in range(5):
        gram = x @ x.T
        x = 3.4445 * x - 4.7750 * gram @ x + 2.0315 * gram @ gram @ x
    expected = x if shape[0] <= shape[1] else x.T
    torch.testing.assert_close(orthogonalised(matrix), expected, atol=1e-6, rtol=1e-6)
    torch.testing.assert_close(orthogonalised(matrix.float()), expected.float(), atol=1e-5, rtol=0)


def test_a_zero_gradient_moves_nothing_but_the_decay() -> None:
    weight = nn.Parameter(torch.ones(4, 4, 1, 1))
    weight.grad = torch.zeros_like(weight)
    Muon([weight], lr=0.1, weight_decay=0.5).step()
    torch.testing.assert_close(weight.detach(), torch.full((4, 4, 1, 1), 0.95))


def test_first_step_of_a_tall_weight_has_the_length_of_its_aspect_ratio() -> None:
    """An orthogonal gradient keeps its singular values equal, so the step is lr * sqrt(outputs / inputs) along it."""
    gradient = torch.eye(16, 4)[:, :, None, None]
    weight = nn.Parameter(torch.zeros(16, 4, 1, 1))
    weight.grad = 7.0 * gradient
    Muon([weight], lr=0.1, weight_decay=0.0).step()
    moved = weight.detach() / (-0.1 * 2.0)
    gain = moved[0, 0, 0, 0]
    assert 0.6 < gain < 1.3
    torch.testing.assert_close(moved, gain * gradient, atol=1e-5, rtol=0)


def test_momentum_remembers() -> None:
    weight = nn.Parameter(torch.zeros(16, 16))
    optimizer = Muon([weight], lr=0.1)
    weight.grad = torch.eye(16)
    optimizer.step()
    after_one = weight.detach().clone()
    weight.grad = torch.zeros(16, 16)
    optimizer.step()
    assert (weight.detach().diagonal() < after_one.diagonal()).all()


def test_every_weight_has_exactly_one_optimiser() -> None:
    model = nn.Sequential(nn.Conv2d(3, 32, 3), nn.BatchNorm2d(32), nn.Conv2d(32, 2, 3), nn.Linear(2, 32))
    (muon, muon_rate), (adamw, adamw_rate) = build_optimizers(model, TrainOptions(optimizer="muon", muon_learning_rate=0.3))
    by_muon = muon.param_groups[0]["params"]
    by_adamw = adamw.param_groups[0]["params"]
    assert (muon_rate, adamw_rate) == (0.3, TrainOptions().learning_rate)
    assert [p is model[0].weight for p in by_muon] == [True]  # two outputs are too few, and a linear layer is not one
    assert sorted(map(id, [*by_muon, *by_adamw])) == sorted(map(id, model.parameters()))
    ((everything, _),) = build_optimizers(model, TrainOptions())
    assert sorted(map(id, everything.param_groups[0]["params"])) == sorted(map(id, model.parameters()))


def test_a_trunk_that_was_trained_before_gets_its_share_of_the_rates() -> None:
    model = nn.ModuleDict({"backbone": nn.Conv2d(16, 16, 3), "head": nn.Conv2d(16, 16, 3)})
    for optimizer, _ in build_optimizers(model, TrainOptions(optimizer="muon", backbone_rate=0.1)):
        shares = {id(p): group["rate_share"] for group in optimizer.param_groups for p in group["params"]}
        assert all(shares[id(p)] == 0.1 for p in model["backbone"].parameters() if id(p) in shares)
        assert all(shares[id(p)] == 1.0 for p in model["head"].parameters() if id(p) in shares)
        assert len(shares) == 2
