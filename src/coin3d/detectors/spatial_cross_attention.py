"""Attention of bird's-eye-view queries to the images that see their pillars (spec detectors 2, SCA)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from coin3d.detectors.deformable_attention import SamplingPlan, sample_values
from coin3d.detectors.pillar_projection import PillarViews


@dataclass(frozen=True, eq=False)
class VisibleQueries:
    """Which queries each camera sees, in rows padded to the camera that sees most; made once for all layers.

    Rigs may differ within the batch: every camera looks up queries of its own sample.

    Args:
        slot: (M, S) query ``sample * Q + q`` in each slot, 0 where the slot is empty.
        used: (M, S) whether the slot is.
        references: (M, S, D, 2) anchors of the queries in the image.
        cameras_per_query: (B, Q, 1) cameras that see any anchor of a query, at least 1.
    """

    slot: Int[Tensor, "m s"]
    used: Bool[Tensor, "m s"]
    references: Float[Tensor, "m s d 2"]
    cameras_per_query: Float[Tensor, "b q 1"]

    @classmethod
    def of(cls, views: PillarViews, sample_index: Int[Tensor, "m"], samples: int) -> VisibleQueries:
        """Gather what the cameras see."""
        seen = views.visible.any(-1)
        queries = seen.shape[1]
        longest = max(1, int(seen.sum(1).max()))
        # a stable sort brings the seen queries of each camera to the front, in order
        row = torch.argsort(seen.to(torch.uint8), dim=1, descending=True, stable=True)[:, :longest]
        used = torch.gather(seen, 1, row)
        references = torch.gather(views.references, 1, row[..., None, None].expand(-1, -1, *views.references.shape[2:]))
        count = torch.zeros(samples, queries, device=seen.device).index_add_(0, sample_index, seen.float())
        slot = torch.where(used, sample_index[:, None] * queries + row, 0)
        return cls(slot, used, references, count.clamp(min=1)[..., None])


class SpatialCrossAttention(nn.Module):
    """Each query looks around the projections of its pillar in every camera that sees it; cameras are averaged.

    Args:
        channels: width of queries and image features.
        heads: attention heads.
        points: looks per head, shared out over the anchors of the pillar in turn.
        dropout: on the output.
        at_anchors: start with looks close to the anchors, each head at one of them (see ``SamplingPlan``).
    """

    def __init__(self, channels: int, heads: int, points: int, dropout: float, at_anchors: bool = False) -> None:
        super().__init__()
        self.plan = SamplingPlan(channels, heads, maps=1, points=points, at_anchors=at_anchors)
        self.value = nn.Linear(channels, channels)
        self.output = nn.Linear(channels, channels)
        self.dropout = nn.Dropout(dropout)

    def forward(
        self, query: Float[Tensor, "b q c"], features: Float[Tensor, "m c h w"], visible: VisibleQueries
    ) -> Float[Tensor, "b q c"]:
        """The queries with what they saw added; those no camera sees get the output's bias only."""
        offsets, weights = (x.flatten(0, 1)[visible.slot] for x in self.plan(query))  # (M, S, heads, 1, points[, 2])
        cells = torch.tensor([features.shape[-1], features.shape[-2]], device=query.device, dtype=offsets.dtype)
        anchors = visible.references.shape[2]
        centre = visible.references.repeat(1, 1, self.plan.points // anchors, 1)[:, :, None, None]
        value = self.value(features.flatten(2).transpose(1, 2)).transpose(1, 2).reshape(features.shape)
        seen = sample_values([value], centre + offsets / cells, weights)
        total = torch.zeros_like(query).flatten(0, 1).to(seen.dtype)
        total = total.index_add(0, visible.slot.flatten(), (seen * visible.used[..., None]).flatten(0, 1))
        mean = total.reshape(query.shape) / visible.cameras_per_query
        attended: Tensor = self.dropout(self.output(mean))
        return query + attended
