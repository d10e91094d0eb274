"""Lifted features refined over columns and depths before they are pooled."""

from __future__ import annotations

import numpy as np
import torch

from coin3d.detectors.depth_aggregation import DepthAggregation
from coin3d.detectors.lift_splat import BevGrid, DepthBins, LiftSplat
from coin3d.detectors.released_lift import ReleasedLiftSplat
from coin3d.geometry import GroundPlane
from coin3d.geometry.camera_tensors import CameraTensors
from small_world import ring_rig


def lifted(seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    depth = torch.rand(3, 12, 8, 12, generator=generator).softmax(1)
    return depth, torch.randn(3, 4, 8, 12, generator=generator)


def test_without_refinement_it_is_the_outer_product() -> None:
    layer = DepthAggregation(4).eval()
    for conv in (layer.reduce[0], layer.refine[0][0], layer.refine[1][0], layer.out):
        torch.nn.init.zeros_(conv.weight)
    torch.nn.init.dirac_(layer.reduce[0].weight)
    torch.nn.init.dirac_(layer.out.weight)
    torch.nn.init.zeros_(layer.out.bias)
    layer.reduce[1].eps = 0.0
    depth, context = lifted()
    expected = torch.einsum("mdhw,mchw->mhwdc", depth, context).relu()
    torch.testing.assert_close(layer(depth, context), expected, rtol=1e-5, atol=1e-6)


def test_rows_of_an_image_do_not_see_each_other_columns_do() -> None:
    torch.manual_seed(0)
    layer, (depth, context) = DepthAggregation(4).eval(), lifted()
    other = context.clone()
    other[1, :, 5, 6] += 1.0
    with torch.no_grad():
        moved = (layer(depth, other) - layer(depth, context)).abs().sum((3, 4)) > 0
    rows = moved.any(2)
    assert rows.nonzero().tolist() == [[1, 5]]
    assert moved[1, 5].sum() > 1


def test_pooling_of_what_is_lifted_already() -> None:
    cameras = CameraTensors.from_cameras(list(ring_rig(3).values()), [GroundPlane()] * 3)
    depth, context = lifted()
    sample, turned = torch.tensor([0, 0, 1]), torch.eye(3).repeat(2, 1, 1)
    turned[1, :2, :2] = torch.tensor([[0.6, -0.8], [0.8, 0.6]])
    grid, bins = BevGrid(half_extent_m=25.6, cell_m=1.6), DepthBins(1.0, 25.0, 2.0)
    for kind in (LiftSplat, ReleasedLiftSplat):
        lift = kind(grid, bins, 8)
        whole = lift.pool(torch.einsum("mdhw,mchw->mhwdc", depth, context), cameras, sample, turned)
        torch.testing.assert_close(whole, lift(depth, context, cameras, sample, turned), rtol=1e-4, atol=1e-5)
        assert np.prod(whole.shape) == 2 * 4 * 32 * 32 and whole.abs().max() > 0.1
