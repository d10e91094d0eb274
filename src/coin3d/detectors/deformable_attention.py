"""Attention that reads a few learned points of a feature map instead of all of it (spec detectors 2, SCA, TSA, decoder)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

_NEAR_ANCHOR_CELLS = 0.5
_PREFERENCE = 2.0  # of logits: a head gives its own anchor seven times the weight of another


def sample_values(
    levels: Sequence[Float[Tensor, "n k _ _"]],
    locations: Float[Tensor, "n q heads levels points 2"],
    weights: Float[Tensor, "n q heads levels points"],
) -> Float[Tensor, "n q k"]:
    """Weighted sums of bilinear samples, per head.

    Args:
        levels: feature maps of any sizes; the k channels are those of head 0, then of head 1, ...
        locations: (x, y) of each sample, 0 and 1 being the outer edges of the map; outside it samples are zero.
        weights: of the samples of each query and head, over all levels and points.
    """
    n, q, heads, _, points, _ = locations.shape
    grid = (2 * locations - 1).permute(3, 0, 2, 1, 4, 5).reshape(-1, n * heads, q, points, 2)
    share = weights.permute(3, 0, 2, 1, 4).reshape(-1, n * heads, 1, q, points)
    total: Tensor | None = None
    for level, features in enumerate(levels):
        per_head = features.reshape(n * heads, -1, *features.shape[-2:])
        samples = F.grid_sample(per_head, grid[level].to(per_head.dtype), padding_mode="zeros", align_corners=False)
        summed = (samples * share[level]).sum(-1)
        total = summed if total is None else total + summed
    if total is None:
        raise ValueError("deformable attention needs a feature map to sample")
    return total.reshape(n, -1, q).transpose(1, 2)


class SamplingPlan(nn.Module):
    """Where each query looks and how much each look counts.

    Args:
        inputs: width of the queries.
        heads: attention heads.
        maps: maps each head looks at; the weights sum to one over the points of each map.
        points: looks per head and map.
        at_anchors: where each point has an anchor of its own: start within half a cell of it, head h at anchor h.
    """

    def __init__(self, inputs: int, heads: int, maps: int, points: int, at_anchors: bool = False) -> None:
        super().__init__()
        self.heads, self.maps, self.points, self.at_anchors = heads, maps, points, at_anchors
        self.offsets = nn.Linear(inputs, heads * maps * points * 2)
        self.weights = nn.Linear(inputs, heads * maps * points)
        self.reset_parameters()

    def reset_parameters(self) -> None:
        """Equal weights; head h looks in its own direction, its p-th point p + 1 cells away."""
        for layer in (self.offsets, self.weights):
            nn.init.zeros_(layer.weight)
            nn.init.zeros_(layer.bias)
        angle = torch.arange(self.heads, device=self.offsets.bias.device) * (2 * math.pi / self.heads)
        direction = torch.stack([angle.cos(), angle.sin()], dim=-1)
        direction = direction / direction.abs().amax(-1, keepdim=True)
        distance = torch.arange(1, self.points + 1, device=direction.device)
        spread = direction[:, None, None] * distance[None, None, :, None]
        with torch.no_grad():
            if self.at_anchors:
                spread = spread * (_NEAR_ANCHOR_CELLS / self.points)
                own = torch.eye(self.points).repeat(-(-self.heads // self.points), 1)[: self.heads, None]
                self.weights.bias.copy_(_PREFERENCE * own.expand(self.heads, self.maps, self.points).flatten())
            self.offsets.bias.copy_(spread.expand(self.heads, self.maps, self.points, 2).flatten())

    def forward(
        self, query: Float[Tensor, "b q c"]
    ) -> tuple[Float[Tensor, "b q heads maps points 2"], Float[Tensor, "b q heads maps points"]]:
        """Offsets in cells of the map, and weights."""
        shape = (*query.shape[:2], self.heads, self.maps, self.points)
        return self.offsets(query).reshape(*shape, 2), self.weights(query).reshape(shape).softmax(-1)
