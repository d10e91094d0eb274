"""Object queries that refine their boxes over a bird's-eye view, layer by layer (spec detectors 2, decoder)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from coin3d.detectors.bevformer_encoder import feed_forward
from coin3d.detectors.deformable_attention import SamplingPlan, sample_values
from coin3d.detectors.object_queries import PRIOR_LOGIT, ObjectQueries
from coin3d.detectors.query_boxes import CODE_SIZE, PLACE, START_OF_SHIFTS, place_boxes
from coin3d.detectors.space_range import SpaceRange, inverse_sigmoid


class BevCrossAttention(nn.Module):
    """Each query looks at points around its reference in the bird's-eye view."""

    def __init__(self, channels: int, heads: int, points: int, dropout: float) -> None:
        super().__init__()
        self.plan = SamplingPlan(channels, heads, maps=1, points=points)
        self.value = nn.Linear(channels, channels)
        self.output = nn.Linear(channels, channels)
        self.dropout = nn.Dropout(dropout)

    def forward(
        self, query: Float[Tensor, "b n c"], bev: Float[Tensor, "b q c"], centre: Float[Tensor, "b n 2"]
    ) -> Float[Tensor, "b n c"]:
        """What the queries saw; ``centre`` is (x, y) from 0 to 1."""
        side = round(bev.shape[1] ** 0.5)
        offsets, weights = self.plan(query)
        value = self.value(bev).transpose(1, 2).reshape(len(bev), -1, side, side)
        seen = sample_values([value], centre[:, :, None, None, None] + offsets / side, weights)
        out: Tensor = self.dropout(self.output(seen))
        return out


class DecoderLayer(nn.Module):
    """Self-attention among queries, attention to the bird's-eye view, a feed-forward network, each followed by its norm."""

    def __init__(self, channels: int, heads: int, points: int, hidden: int, dropout: float) -> None:
        super().__init__()
        self.self_attention = nn.MultiheadAttention(channels, heads, dropout, batch_first=True)
        self.dropout = nn.Dropout(dropout)
        self.cross_attention = BevCrossAttention(channels, heads, points, dropout)
        self.ffn = feed_forward(channels, hidden, dropout)
        self.norms = nn.ModuleList(nn.LayerNorm(channels) for _ in range(3))

    def forward(
        self,
        query: Float[Tensor, "b n c"],
        position: Float[Tensor, "b n c"],
        bev: Float[Tensor, "b q c"],
        centre: Float[Tensor, "b n 2"],
    ) -> Float[Tensor, "b n c"]:
        placed = query + position
        attended, _ = self.self_attention(placed, placed, query, need_weights=False)
        query = self.norms[0](query + self.dropout(attended))
        query = self.norms[1](query + self.cross_attention(query + position, bev, centre))
        out: Tensor = self.norms[2](query + self.ffn(query))
        return out


class BevQueryDecoder(nn.Module):
    """Learned queries, each with a learned place to start from.

    Args:
        layers: how many.
        queries: N.
        classes: K.
        channels: width.
        heads: attention heads.
        points: looks per head into the bird's-eye view.
        hidden: width inside the feed-forward networks.
        dropout: in all of them.
    """

    def __init__(
        self, layers: int, queries: int, classes: int, channels: int, heads: int, points: int, hidden: int, dropout: float
    ) -> None:
        super().__init__()
        self.classes = classes
        self.queries = nn.Parameter(torch.randn(queries, 2 * channels))  # position beside content
        self.start = nn.Linear(channels, 3)
        self.layers = nn.ModuleList(DecoderLayer(channels, heads, points, hidden, dropout) for _ in range(layers))
        self.class_branches = nn.ModuleList(_class_branch(channels, classes) for _ in range(layers))
        self.box_branches = nn.ModuleList(_box_branch(channels) for _ in range(layers))

    @torch.no_grad()
    def start_near_references(self) -> None:
        """Make the first shifts of boxes small."""
        for branch in self.box_branches:
            branch.get_submodule("4").get_parameter("weight").mul_(START_OF_SHIFTS)

    def forward(
        self, bev: Float[Tensor, "b q c"], space: SpaceRange, seeds: ObjectQueries | None = None
    ) -> tuple[Float[Tensor, "l b n k"], Float[Tensor, "l b n 10"]]:
        """Class logits and boxes (see query_boxes) after every layer.

        Args:
            bev: features of a square grid, row by row.
            space: range of space of that grid, in which the boxes lie.
            seeds: further queries.
        """
        position, content = self.queries.expand(len(bev), -1, -1).chunk(2, dim=-1)
        learned = ObjectQueries.learned(self.start(position).float().sigmoid(), position, content, self.classes)
        queries = learned.joined(seeds)
        query, reference = queries.content, queries.place
        logits, boxes = [], []
        for layer, classify, refine in zip(self.layers, self.class_branches, self.box_branches, strict=True):
            query = layer(query, queries.position, bev, reference[..., :2])
            with torch.autocast(bev.device.type, enabled=False):  # half precision would put boxes on a grid of decimetres
                logits.append(classify(query.float()) + queries.logits)
                raw = refine(query.float())
                boxes.append(place_boxes(raw, reference, space, queries.code))
                # each layer learns its own correction: no gradient through the chain of places
                reference = (raw[..., PLACE] + inverse_sigmoid(reference)).sigmoid().detach()
        return torch.stack(logits), torch.stack(boxes)


def _class_branch(channels: int, classes: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for _ in range(2):
        layers += [nn.Linear(channels, channels), nn.LayerNorm(channels), nn.ReLU(inplace=True)]
    last = nn.Linear(channels, classes)
    nn.init.constant_(last.bias, PRIOR_LOGIT)
    return nn.Sequential(*layers, last)


def _box_branch(channels: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for _ in range(2):
        layers += [nn.Linear(channels, channels), nn.ReLU(inplace=True)]
    return nn.Sequential(*layers, nn.Linear(channels, CODE_SIZE))
