"""BEVFormer's encoder: bird's-eye-view queries look back in time and out through the cameras (spec detectors 2)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from coin3d.detectors.bev_history import BevHistory
from coin3d.detectors.spatial_cross_attention import SpatialCrossAttention, VisibleQueries
from coin3d.detectors.temporal_self_attention import TemporalSelfAttention


class LearnedPosition(nn.Module):
    """A learned vector per column beside a learned vector per row.

    Args:
        side: rows and columns of the map.
        channels: of the encoding; half of them tell columns apart, half rows.
    """

    def __init__(self, side: int, channels: int) -> None:
        super().__init__()
        self.columns = nn.Parameter(torch.randn(side, channels // 2))
        self.rows = nn.Parameter(torch.randn(side, channels // 2))

    def forward(self) -> Float[Tensor, "q c"]:
        side = len(self.rows)
        columns = self.columns[None].expand(side, -1, -1)
        rows = self.rows[:, None].expand(-1, side, -1)
        return torch.cat([columns, rows], dim=-1).flatten(0, 1)


def feed_forward(channels: int, hidden: int, dropout: float) -> nn.Sequential:
    """Two linear layers; the residual is the caller's."""
    return nn.Sequential(
        nn.Linear(channels, hidden),
        nn.ReLU(inplace=True),
        nn.Dropout(dropout),
        nn.Linear(hidden, channels),
        nn.Dropout(dropout),
    )


class EncoderLayer(nn.Module):
    """Temporal attention, spatial attention and a feed-forward network, each followed by its norm."""

    def __init__(
        self,
        channels: int,
        heads: int,
        temporal_points: int,
        spatial_points: int,
        hidden: int,
        dropout: float,
        at_anchors: bool,
    ) -> None:
        super().__init__()
        self.temporal = TemporalSelfAttention(channels, heads, temporal_points, dropout)
        self.spatial = SpatialCrossAttention(channels, heads, spatial_points, dropout, at_anchors)
        self.ffn = feed_forward(channels, hidden, dropout)
        self.norms = nn.ModuleList(nn.LayerNorm(channels) for _ in range(3))

    def forward(
        self,
        query: Float[Tensor, "b q c"],
        position: Float[Tensor, "q c"],
        maps: tuple[Float[Tensor, "b q c"], Float[Tensor, "b q c"]],
        references: tuple[Float[Tensor, "b q 2"], Float[Tensor, "b q 2"]],
        features: Float[Tensor, "m c h w"],
        visible: VisibleQueries,
        side: int,
    ) -> Float[Tensor, "b q c"]:
        query = self.norms[0](self.temporal(query, position, maps, references, (side, side)))
        query = self.norms[1](self.spatial(query, features, visible))
        out: Tensor = self.norms[2](query + self.ffn(query))
        return out


class BevFormerEncoder(nn.Module):
    """A stack of layers over one query per cell of a square grid.

    Args:
        layers: how many.
        channels: width.
        heads: attention heads.
        temporal_points: looks per head into each of the two maps.
        spatial_points: looks per head into each camera.
        hidden: width inside the feed-forward networks.
        dropout: in all of them.
        at_anchors: how the looks into the cameras start (see ``SamplingPlan``).
    """

    def __init__(
        self,
        layers: int,
        channels: int,
        heads: int,
        temporal_points: int,
        spatial_points: int,
        hidden: int,
        dropout: float,
        at_anchors: bool = False,
    ) -> None:
        super().__init__()
        self.layers = nn.ModuleList(
            EncoderLayer(channels, heads, temporal_points, spatial_points, hidden, dropout, at_anchors) for _ in range(layers)
        )

    def forward(
        self,
        query: Float[Tensor, "b q c"],
        position: Float[Tensor, "q c"],
        centres: Float[Tensor, "q 2"],
        features: Float[Tensor, "m c h w"],
        visible: VisibleQueries,
        history: BevHistory | None = None,
    ) -> Float[Tensor, "b q c"]:
        """Bird's-eye-view features, row by row.

        Args:
            query: what each cell starts from.
            position: positional encoding of the cells.
            centres: (x, y) of the cells from 0 to 1.
            features: image features of the cameras.
            visible: which camera sees which query.
            history: the previous bird's-eye view; without it the queries look at themselves twice.
        """
        side = round(len(position) ** 0.5)
        present = centres.expand(len(query), -1, -1)
        references = (present if history is None else history.references, present)
        first = query
        for layer in self.layers:
            maps = (query, query) if history is None else (history.bev, query if history.refresh else first)
            query = layer(query, position, maps, references, features, visible, side)
        return query
