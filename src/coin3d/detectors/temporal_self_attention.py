"""Attention of bird's-eye-view queries to the present and the previous bird's-eye view (spec detectors 2, TSA)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from coin3d.detectors.deformable_attention import SamplingPlan, sample_values


class TemporalSelfAttention(nn.Module):
    """Each query looks at points around its own cell in two maps, previous and present; the two answers are averaged.

    Args:
        channels: width of queries and maps.
        heads: attention heads.
        points: looks per head and map.
        dropout: on the output.
    """

    def __init__(self, channels: int, heads: int, points: int, dropout: float) -> None:
        super().__init__()
        self.plan = SamplingPlan(2 * channels, heads, maps=2, points=points)
        self.value = nn.Linear(channels, channels)
        self.output = nn.Linear(channels, channels)
        self.dropout = nn.Dropout(dropout)

    def forward(
        self,
        query: Float[Tensor, "b q c"],
        position: Float[Tensor, "q c"],
        maps: tuple[Float[Tensor, "b q c"], Float[Tensor, "b q c"]],
        references: tuple[Float[Tensor, "b q 2"], Float[Tensor, "b q 2"]],
        shape: tuple[int, int],
    ) -> Float[Tensor, "b q c"]:
        """The queries with what they saw added.

        Args:
            query: one per cell, row by row.
            position: positional encoding of the cells.
            maps: previous and present map; twice the query where there is no history.
            references: where the cells lie in either map, (x, y) from 0 to 1.
            shape: rows and columns of the maps.
        """
        offsets, weights = self.plan(torch.cat([maps[0], query + position], dim=-1))
        cells = torch.tensor([shape[1], shape[0]], device=query.device, dtype=offsets.dtype)
        seen = []
        for index, (features, centre) in enumerate(zip(maps, references, strict=True)):
            value = self.value(features).transpose(1, 2).reshape(len(query), -1, *shape)
            locations = centre[:, :, None, None, None] + offsets[:, :, :, index : index + 1] / cells
            seen.append(sample_values([value], locations, weights[:, :, :, index : index + 1]))
        attended: Tensor = self.dropout(self.output((seen[0] + seen[1]) / 2))
        return query + attended
