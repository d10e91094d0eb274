"""Where each (pixel, depth bin) of each camera falls in bird's-eye view."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from itertools import pairwise

import torch
from jaxtyping import Float, Int
from torch import Tensor

from coin3d.detectors.bev_pool import bev_pool
from coin3d.geometry.camera_tensors import CameraTensors


@dataclass(frozen=True)
class DepthBins:
    """Equal depth bins over [min_m, max_m); a bin stands for its centre."""

    min_m: float = 1.0
    max_m: float = 60.0
    step_m: float = 0.5

    def __post_init__(self) -> None:
        if not 0 < self.min_m < self.max_m or self.step_m <= 0:
            raise ValueError(f"depth bins need 0 < min < max and a positive step, got {self}")
        if abs(self.count * self.step_m - (self.max_m - self.min_m)) > 1e-6:
            raise ValueError(f"the range of the depth bins is not a whole number of steps: {self}")

    @property
    def count(self) -> int:
        return round((self.max_m - self.min_m) / self.step_m)

    def centres_m(self, device: torch.device | str = "cpu") -> Float[Tensor, "d"]:
        return self.min_m + self.step_m * (torch.arange(self.count, device=device) + 0.5)

    def index(self, depth_m: Float[Tensor, "..."]) -> Int[Tensor, "..."]:
        """Bin of each depth, -1 outside the range (and for 0, 'unknown')."""
        bins = torch.floor((depth_m - self.min_m) / self.step_m)
        return torch.where((bins >= 0) & (bins < self.count), bins, -1.0).long()


@dataclass(frozen=True)
class BevGrid:
    """Square grid of cells around the ego origin: x and y in [-half_extent_m, half_extent_m), rows are y, columns x.

    Args:
        half_extent_m: from the origin to each side.
        cell_m: side of a cell.
        z_edges_m: rising heights in the ego frame that bound the slabs a cell is cut into. One slab (as released) sums
            over all heights; with more, what stands on the road is told from the road by where it lies, before the
            network has learned what it looks like.
    """

    half_extent_m: float = 51.2
    cell_m: float = 0.8
    z_edges_m: tuple[float, ...] = (-5.0, 3.0)

    def __post_init__(self) -> None:
        if self.cell_m <= 0 or self.half_extent_m <= 0:
            raise ValueError(f"a BEV grid needs positive extent and cells, got {self}")
        edges = self.z_edges_m
        if len(edges) < 2 or any(low >= high for low, high in pairwise(edges)):
            raise ValueError(f"the heights that bound a BEV grid are two or more rising values, got {edges}")
        if abs(self.side * self.cell_m - 2 * self.half_extent_m) > 1e-6:
            raise ValueError(f"the BEV grid is not a whole number of cells wide: {self}")

    @property
    def side(self) -> int:
        """Number of cells along x and along y."""
        return round(2 * self.half_extent_m / self.cell_m)

    @property
    def slabs(self) -> int:
        """Number of height slabs."""
        return len(self.z_edges_m) - 1


class LiftSplat:
    """Lifts image features along their rays and sums them into the grid (paper's bottom-up BEV paradigm).

    For cameras seen before (a fixed rig at inference) the indices are reused.
    """

    def __init__(self, grid: BevGrid, bins: DepthBins, stride: int, cached_rigs: int = 4) -> None:
        self.grid, self.bins, self.stride, self.cached_rigs = grid, bins, stride, cached_rigs
        self._cache: OrderedDict[tuple[bytes, ...], Tensor] = OrderedDict()

    def __call__(
        self,
        depth: Float[Tensor, "m d h w"],
        context: Float[Tensor, "m c h w"],
        cameras: CameraTensors,
        sample_index: Int[Tensor, "m"],
        bev_from_ego: Float[Tensor, "b 3 3"],
        reuse: bool = False,
    ) -> Float[Tensor, "b k y x"]:
        """Pool context weighted by depth probabilities; ``reuse`` looks the cameras up in the cache first.

        The channels are those of the lowest slab, then those of the next.
        """
        m, d, h, w = depth.shape
        flat_depth = depth.permute(0, 2, 3, 1).reshape(m * h * w, d)
        flat_context = context.permute(0, 2, 3, 1).reshape(m * h * w, -1)
        return self._pool(flat_depth, flat_context, cameras, sample_index, bev_from_ego, reuse)

    def pool(
        self,
        lifted: Float[Tensor, "m h w d c"],
        cameras: CameraTensors,
        sample_index: Int[Tensor, "m"],
        bev_from_ego: Float[Tensor, "b 3 3"],
        reuse: bool = False,
    ) -> Float[Tensor, "b k y x"]:
        """Pool features that are there for every depth already."""
        rows = lifted.reshape(-1, lifted.shape[-1])
        return self._pool(rows.new_ones(len(rows), 1), rows, cameras, sample_index, bev_from_ego, reuse)

    def _pool(
        self,
        weight: Float[Tensor, "p q"],
        rows: Float[Tensor, "p c"],
        cameras: CameraTensors,
        sample_index: Int[Tensor, "m"],
        bev_from_ego: Float[Tensor, "b 3 3"],
        reuse: bool,
    ) -> Float[Tensor, "b k y x"]:
        lookup = self._cached_cells if reuse else self.cells
        cell = lookup(cameras, sample_index, bev_from_ego).reshape(weight.shape)
        side, samples = self.grid.side, len(bev_from_ego)
        bev = bev_pool(weight, rows, cell, samples * side * side * self.grid.slabs)
        return bev.reshape(samples, side, side, -1).permute(0, 3, 1, 2)

    def cells(
        self, cameras: CameraTensors, sample_index: Int[Tensor, "m"], bev_from_ego: Float[Tensor, "b 3 3"]
    ) -> Int[Tensor, "m h w d"]:
        """Row ((sample * side + y) * side + x) * slabs + slab of each point, -1 outside the grid."""
        device = cameras.K.device
        h, w = cameras.height_px // self.stride, cameras.width_px // self.stride
        v, u = torch.meshgrid(
            (torch.arange(h, device=device) + 0.5) * self.stride,
            (torch.arange(w, device=device) + 0.5) * self.stride,
            indexing="ij",
        )
        pixels = torch.stack([u, v, torch.ones_like(u)], dim=-1)
        bev_from_ego_cam = bev_from_ego[sample_index]
        with torch.autocast(device.type, enabled=False):  # matrix products in bfloat16 would move points by metres
            direction_from_pixel = bev_from_ego_cam @ cameras.ego_from_cam[:, :3, :3] @ torch.linalg.inv(cameras.K)
            direction = torch.einsum("mij,hwj->mhwi", direction_from_pixel, pixels)
            origin = torch.einsum("mij,mj->mi", bev_from_ego_cam, cameras.ego_from_cam[:, :3, 3])
        points = origin[:, None, None, None] + direction[:, :, :, None] * self.bins.centres_m(device)[:, None]
        grid = self.grid
        column = torch.floor((points[..., 0] + grid.half_extent_m) / grid.cell_m)
        row = torch.floor((points[..., 1] + grid.half_extent_m) / grid.cell_m)
        inside = (column >= 0) & (column < grid.side) & (row >= 0) & (row < grid.side)
        edges = torch.tensor(grid.z_edges_m, device=device)
        slab = torch.bucketize(points[..., 2].contiguous(), edges, right=True) - 1
        inside &= (slab >= 0) & (slab < grid.slabs)
        index = ((sample_index[:, None, None, None] * grid.side + row) * grid.side + column) * grid.slabs + slab
        return torch.where(inside, index, -1).to(torch.int32)

    def _cached_cells(
        self, cameras: CameraTensors, sample_index: Int[Tensor, "m"], bev_from_ego: Float[Tensor, "b 3 3"]
    ) -> Int[Tensor, "m h w d"]:
        tensors = (cameras.K, cameras.ego_from_cam, sample_index, bev_from_ego)
        size = f"{cameras.height_px}x{cameras.width_px}".encode()
        key = (*(t.cpu().numpy().tobytes() for t in tensors), size, str(cameras.K.device).encode())
        if key not in self._cache:
            self._cache[key] = self.cells(cameras, sample_index, bev_from_ego)
            while len(self._cache) > self.cached_rigs:
                self._cache.popitem(last=False)
        self._cache.move_to_end(key)
        return self._cache[key]
