"""Move a bird's-eye view along with the vehicle."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F  # noqa: N812

from coin3d.detectors.lift_splat import BevGrid


def warp_bev(
    bev: Float[Tensor, "b c y x"], source_from_target: Float[Tensor, "b 4 4"], grid: BevGrid, first_cell: float = 0.5
) -> Float[Tensor, "b c y x"]:
    """What a grid around one pose holds, seen from another: bilinear, zero from outside.

    Args:
        bev: features of the source grid.
        source_from_target: BEV frame of the result to that of ``bev``; heights are ignored.
        grid: of both.
        first_cell: where in units of cells the feature of the first cell sits; 0.5 is its centre, the released code says 0.
    """
    flat = source_from_target[:, (0, 1, 3)][:, :, (0, 1, 3)].double()
    start = grid.cell_m * first_cell - grid.half_extent_m
    metres_from_cell = torch.tensor([[grid.cell_m, 0, start], [0, grid.cell_m, start], [0, 0, 1]], dtype=torch.float64)
    metres_from_cell = metres_from_cell.to(flat.device)
    source_from_target_cell = torch.linalg.inv(metres_from_cell) @ flat @ metres_from_cell
    y, x = torch.meshgrid(*(torch.arange(n, device=bev.device, dtype=torch.float64) for n in bev.shape[-2:]), indexing="ij")
    cells = torch.stack([x, y, torch.ones_like(x)], dim=-1)
    at = torch.einsum("bij,yxj->byxi", source_from_target_cell, cells)[..., :2]
    span = torch.tensor([bev.shape[-1] - 1, bev.shape[-2] - 1], device=bev.device)
    exact = torch.promote_types(bev.dtype, torch.float32)  # places in half precision are off by half a cell
    at = (2 * at / span - 1).to(exact)
    return F.grid_sample(bev.to(exact), at, mode="bilinear", padding_mode="zeros", align_corners=True).to(bev.dtype)
