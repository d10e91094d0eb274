"""The previous bird's-eye view, seen from where the vehicle is now."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F  # noqa: N812

from coin3d.detectors.lift_splat import BevGrid
from coin3d.detectors.pillar_projection import cell_centres, pillar_anchors


@dataclass(frozen=True, eq=False)
class BevHistory:
    """The previous bird's-eye view, aligned with the present one.

    Args:
        bev: (B, Q, C) previous features, one per present cell.
        references: (B, Q, 2) where in ``bev`` the queries look, (x, y) from 0 to 1.
        refresh: the present map beside it is each layer's own; False keeps the first layer's (released weights).
    """

    bev: Float[Tensor, "b q c"]
    references: Float[Tensor, "b q 2"]
    refresh: bool = True


def align_history(
    previous_bev: Float[Tensor, "b q c"], previous_from_current: Float[Tensor, "b 4 4"], grid: BevGrid
) -> BevHistory:
    """The previous bird's-eye view moved to the present one: bilinear, zero where it did not reach.

    Args:
        previous_bev: features, row by row.
        previous_from_current: from the present to the previous BEV frame.
        grid: the grid of both.
    """
    centres = cell_centres(grid, previous_bev.device)
    ground = pillar_anchors(grid, (0.0,), previous_bev.device)[:, 0].double()
    moved = torch.einsum("bij,qj->bqi", previous_from_current[:, :2, :3].double(), ground)
    moved = moved + previous_from_current[:, None, :2, 3].double()
    exact = torch.promote_types(previous_bev.dtype, torch.float32)  # places in half precision are off by half a cell
    where = (moved / grid.half_extent_m).to(exact)[:, None]
    maps = previous_bev.to(exact).transpose(1, 2).reshape(len(previous_bev), -1, grid.side, grid.side)
    aligned = F.grid_sample(maps, where, padding_mode="zeros", align_corners=False)[:, :, 0].transpose(1, 2)
    return BevHistory(aligned.to(previous_bev.dtype), centres.expand(len(previous_bev), -1, -1))
