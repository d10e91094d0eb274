"""Lifting exactly as the authors' released code does it, for converted weights and parity tests only.

Models trained by this project use ``lift_splat.LiftSplat``. The differences, all of them in this file: image cells are spread
from the first to the last pixel instead of lying at their centres, a depth bin stands for its near edge, and positions
are cut towards zero, so that the first cells also take what lies up to one cell outside of the grid (spec official_code 1.3).
"""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from coin3d.detectors.lift_splat import LiftSplat
from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.priors.released import from_whole_pixels


class ReleasedLiftSplat(LiftSplat):
    """``LiftSplat`` with the released geometry."""

    def cells(
        self, cameras: CameraTensors, sample_index: Int[Tensor, "m"], bev_from_ego: Float[Tensor, "b 3 3"]
    ) -> Int[Tensor, "m h w d"]:
        """Row ((sample * side + y) * side + x) * slabs + slab of each point, -1 outside the grid."""
        grid, points = self.grid, self.points(cameras, sample_index, bev_from_ego)
        low_m, high_m = grid.z_edges_m[0], grid.z_edges_m[-1]
        column = torch.trunc((points[..., 0] + grid.half_extent_m) / grid.cell_m)
        row = torch.trunc((points[..., 1] + grid.half_extent_m) / grid.cell_m)
        layer = torch.trunc((points[..., 2] - low_m) / (high_m - low_m))
        inside = (column >= 0) & (column < grid.side) & (row >= 0) & (row < grid.side) & (layer == 0)
        index = (sample_index[:, None, None, None] * grid.side + row) * grid.side + column
        return torch.where(inside, index, -1).to(torch.int32)

    def points(
        self, cameras: CameraTensors, sample_index: Int[Tensor, "m"], bev_from_ego: Float[Tensor, "b 3 3"]
    ) -> Float[Tensor, "m h w d 3"]:
        """The points that stand for every cell and depth bin, in the BEV frame of their samples (m)."""
        device = cameras.K.device
        h, w = cameras.height_px // self.stride, cameras.width_px // self.stride
        v, u = torch.meshgrid(
            torch.linspace(0, cameras.height_px - 1, h, device=device),
            torch.linspace(0, cameras.width_px - 1, w, device=device),
            indexing="ij",
        )
        near_edges_m = self.bins.min_m + self.bins.step_m * torch.arange(self.bins.count, device=device)
        with torch.autocast(device.type, enabled=False):
            # single precision in the released order: a point on a border falls into the cell it fell into there
            scaled = torch.stack([u, v, torch.ones_like(u)], dim=-1)[:, :, None] * near_edges_m[:, None]
            rotation = cameras.ego_from_cam[:, :3, :3] @ torch.linalg.inv(from_whole_pixels(cameras.K).float())
            ego = torch.einsum("mij,hwdj->mhwdi", rotation, scaled) + cameras.ego_from_cam[:, None, None, None, :3, 3]
            return torch.einsum("mij,mhwdj->mhwdi", bev_from_ego[sample_index], ego)
