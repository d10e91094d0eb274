"""Decoder of object queries: attention among the queries, then from the queries to the image cells of their sample."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn


class QueryDecoder(nn.Module):
    """Layers in a row; the output of every one passes the same last norm (spec detectors 3.7).

    Args:
        layers: their number.
        channels: of queries and memory.
        heads: of each attention.
        hidden: width of the feed-forward part.
        dropout: in all three parts of a layer.
    """

    def __init__(self, layers: int, channels: int, heads: int, hidden: int, dropout: float) -> None:
        super().__init__()
        self.layers = nn.ModuleList(_DecoderLayer(channels, heads, hidden, dropout) for _ in range(layers))
        self.norm = nn.LayerNorm(channels)
        for p in self.parameters():
            if p.ndim > 1:
                nn.init.xavier_uniform_(p)

    def forward(
        self,
        query: Float[Tensor, "b q c"],
        query_position: Float[Tensor, "b q c"],
        memory: Float[Tensor, "b s c"],
        memory_position: Float[Tensor, "b s c"],
        padding: Bool[Tensor, "b s"] | None,
    ) -> Float[Tensor, "l b q c"]:
        """The queries after each layer."""
        outputs = []
        key = memory + memory_position
        for layer in self.layers:
            query = layer(query, query_position, key, memory, padding)
            outputs.append(self.norm(query))
        return torch.stack(outputs)


class _DecoderLayer(nn.Module):
    def __init__(self, channels: int, heads: int, hidden: int, dropout: float) -> None:
        super().__init__()
        self.among_queries = nn.MultiheadAttention(channels, heads, dropout, batch_first=True)
        self.to_memory = nn.MultiheadAttention(channels, heads, dropout, batch_first=True)
        self.feed_forward = nn.Sequential(
            nn.Linear(channels, hidden), nn.ReLU(inplace=True), nn.Dropout(dropout), nn.Linear(hidden, channels)
        )
        self.norms = nn.ModuleList(nn.LayerNorm(channels) for _ in range(3))
        self.dropout = nn.Dropout(dropout)

    def forward(
        self,
        query: Float[Tensor, "b q c"],
        position: Float[Tensor, "b q c"],
        key: Float[Tensor, "b s c"],
        value: Float[Tensor, "b s c"],
        padding: Bool[Tensor, "b s"] | None,
    ) -> Float[Tensor, "b q c"]:
        placed = query + position
        found, _ = self.among_queries(placed, placed, query, need_weights=False)
        query = self.norms[0](query + self.dropout(found))
        found, _ = self.to_memory(query + position, key, value, key_padding_mask=padding, need_weights=False)
        query = self.norms[1](query + self.dropout(found))
        out: Tensor = self.norms[2](query + self.dropout(self.feed_forward(query)))
        return out


def gather_samples(cells: Float[Tensor, "m c h w"], sample_index: Int[Tensor, "m"], samples: int) -> Float[Tensor, "b s c"]:
    """The image cells of each sample in a row (camera, row, column); samples with fewer cameras end in zeros."""
    tokens = cells.flatten(2).transpose(1, 2)
    counts = torch.bincount(sample_index, minlength=samples).tolist()
    rows = [part.flatten(0, 1) for part in torch.split(tokens, counts)]
    return torch.nn.utils.rnn.pad_sequence(rows, batch_first=True)


def sample_padding(sample_index: Int[Tensor, "m"], samples: int, cells: int) -> Bool[Tensor, "b s"] | None:
    """True where ``gather_samples`` filled up with zeros; None if all samples have the same number of cameras.

    Raises:
        ValueError: a sample without cameras.
    """
    counts = torch.bincount(sample_index, minlength=samples)
    fewest, most = int(counts.min()), int(counts.max())
    if not fewest:
        raise ValueError(f"sample {int(counts.argmin())} of the batch has no camera to look through")
    if fewest == most:
        return None
    return torch.arange(most * cells, device=counts.device)[None] >= counts[:, None] * cells
