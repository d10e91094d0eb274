"""Lift-splat pooling: sum depth-weighted context vectors into bird's-eye-view cells, without the 5-D outer product."""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from coin3d.native import bev_pool_backward, bev_pool_forward


def bev_pool_reference(
    depth: Float[Tensor, "p d"], context: Float[Tensor, "p c"], cell: Int[Tensor, "p d"], num_cells: int
) -> Float[Tensor, "n c"]:
    """The definition, one depth bin at a time; runs on any device and differentiates by autograd."""
    bev = context.new_zeros(num_cells + 1, context.shape[1])  # the last row collects what falls outside
    for k in range(depth.shape[1]):
        rows = torch.where(cell[:, k] < 0, num_cells, cell[:, k]).long()
        bev = bev.index_add(0, rows, depth[:, k : k + 1] * context)
    return bev[:num_cells]


def bev_pool(
    depth: Float[Tensor, "p d"], context: Float[Tensor, "p c"], cell: Int[Tensor, "p d"], num_cells: int
) -> Float[Tensor, "n c"]:
    """``out[cell[p, k]] += depth[p, k] * context[p]`` for all pixels p and bins k; cell -1 is dropped.

    Native on a CPU (float32, the same sums for any number of threads), the reference elsewhere.
    """
    if depth.device.type != "cpu":
        return bev_pool_reference(depth, context, cell, num_cells)
    pooled: Tensor = _NativeBevPool.apply(depth.float(), context.float(), cell, num_cells)
    return pooled


class _NativeBevPool(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, depth: Tensor, context: Tensor, cell: Tensor, num_cells: int) -> Tensor:
        depth, context, cell = depth.contiguous(), context.contiguous(), cell.contiguous()
        bev = context.new_empty(num_cells, context.shape[1])
        bev_pool_forward(depth.detach().numpy(), context.detach().numpy(), cell.numpy(), bev.numpy(), torch.get_num_threads())
        ctx.save_for_backward(depth, context, cell)
        return bev

    @staticmethod
    def backward(ctx: Any, *grads: Any) -> tuple[Tensor, Tensor, None, None]:
        depth, context, cell = ctx.saved_tensors
        grad_depth, grad_context = torch.empty_like(depth), torch.empty_like(context)
        bev_pool_backward(
            grads[0].float().contiguous().numpy(),
            depth.detach().numpy(),
            context.detach().numpy(),
            cell.numpy(),
            grad_depth.numpy(),
            grad_context.numpy(),
            torch.get_num_threads(),
        )
        return grad_depth, grad_context, None, None
