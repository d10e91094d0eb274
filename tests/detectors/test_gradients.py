"""Gradients of every operator that is not a layer of PyTorch, against finite differences in double precision."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.autograd import gradcheck

from coin3d.detectors.bev_history import align_history
from coin3d.detectors.bev_pool import bev_pool, bev_pool_reference
from coin3d.detectors.bev_warp import warp_bev
from coin3d.detectors.center_targets import focal_loss
from coin3d.detectors.lift_splat import BevGrid
from coin3d.detectors.pillar_projection import PillarViews
from coin3d.detectors.query_boxes import place_boxes
from coin3d.detectors.space_range import SpaceRange
from coin3d.detectors.spatial_cross_attention import SpatialCrossAttention, VisibleQueries
from coin3d.geometry import Pose
from coin3d.priors import PriorSet
from coin3d.priors.modulation import SpatialModulation

GRID = BevGrid(2.0, 1.0)


def drawn(*shape: int) -> Tensor:
    """Numbers of a fixed seed that ask for a gradient."""
    return torch.randn(*shape, generator=torch.Generator().manual_seed(sum(shape)), dtype=torch.float64).requires_grad_()


def moved(x_m: float, yaw_rad: float) -> Tensor:
    return torch.from_numpy(Pose.from_euler(yaw_rad, 0, 0, (x_m, 0.2, 0)).matrix.copy())[None]


def test_bev_pool_native_and_reference() -> None:
    """The native code is float32: its gradient is compared with the reference's, which is checked in double."""
    cell = torch.tensor([[0, 2, -1], [2, 2, 1]], dtype=torch.int32)
    depth, context = drawn(2, 3), drawn(2, 4)
    assert gradcheck(lambda d, c: bev_pool_reference(d, c, cell, 3), (depth, context))
    wanted = torch.randn(3, 4, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    exact = torch.autograd.grad((bev_pool_reference(depth, context, cell, 3) * wanted).sum(), (depth, context))
    fast = torch.autograd.grad((bev_pool(depth, context, cell, 3) * wanted).sum(), (depth, context))
    for a, b in zip(fast, exact, strict=True):
        torch.testing.assert_close(a.double(), b, rtol=1e-5, atol=1e-5)


def test_moving_a_map() -> None:
    assert gradcheck(lambda bev: warp_bev(bev, moved(0.7, 0.3), GRID), drawn(1, 2, 4, 4))
    assert gradcheck(lambda bev: align_history(bev, moved(-0.4, 0.2), GRID).bev, drawn(1, 16, 3))


def test_modulation() -> None:
    layer = SpatialModulation(3, PriorSet(), "conv3", True).double()
    prior = drawn(2, 9, 3, 4).detach()
    assert gradcheck(lambda features: layer(features, prior), drawn(2, 3, 3, 4))


def test_spatial_cross_attention() -> None:
    """Two cameras that see different halves of the queries."""
    torch.manual_seed(0)
    attention = SpatialCrossAttention(4, 2, 4, 0.0).double()
    visible = torch.tensor([[[True, True], [True, False], [False, False]], [[False, False], [True, True], [False, True]]])
    references = torch.rand(2, 3, 2, 2, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    seen = VisibleQueries.of(PillarViews(references, visible), torch.tensor([0, 0]), 1)
    assert gradcheck(lambda query, features: attention(query, features, seen), (drawn(1, 3, 4), drawn(2, 4, 3, 5)))


def test_heat_map_loss() -> None:
    target = torch.tensor([[[[1.0, 0.6, 0.0], [0.3, 0.0, 1.0]]]], dtype=torch.float64)
    assert gradcheck(lambda logits: focal_loss(logits, target), drawn(1, 1, 2, 3))


def test_placing_boxes() -> None:
    space = SpaceRange((-5.0, -5.0, -1.0), (5.0, 5.0, 3.0))
    reference = torch.tensor([[0.2, 0.5, 0.7], [0.9, 0.1, 0.4]], dtype=torch.float64)
    assert gradcheck(lambda raw: place_boxes(raw, reference, space), drawn(2, 10))
