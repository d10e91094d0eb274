"""Object queries that start from what the image cells show, beside those that are learned.

A learned query starts anywhere and has to find its object through attention that is yet to be learned; from random weights that
takes days. The perspective head is right after minutes. Its best cells become queries that start at the place it sees, with
the cell's feature: the hybrid queries of BEVFormer v2. No released weights have them.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from coin3d.detectors.batch import Batch
from coin3d.detectors.perspective import lift_perspective
from coin3d.detectors.position_embedding_3d import sine_code
from coin3d.detectors.space_range import SpaceRange

_CENTRE_SHARPNESS = 4.0  # a cell beside that of the centre counts exp(-1)
_BESIDE_A_PEAK = 0.01  # such cells only fill up
_EDGE = 0.005  # places keep clear of the ends of the range, where shifts in logits move nothing


@dataclass(frozen=True, eq=False)
class Seeds:
    """P queries of each sample.

    Args:
        place: (B, P, 3) 0..1 in the range of the boxes.
        heading: (B, P, 2) sine and cosine of the yaw in the frame of the boxes.
        position: (B, P, C) embedding of the place.
        content: (B, P, C) what the query starts from.
    """

    place: Float[Tensor, "b p 3"]
    heading: Float[Tensor, "b p 2"]
    position: Float[Tensor, "b p c"]
    content: Float[Tensor, "b p c"]


class ObjectSeeds(nn.Module):
    """Seeds of object queries from the perspective head.

    Args:
        count: P, seeds of each sample.
        inputs: channels of the image feature.
        channels: C, of the queries.
    """

    def __init__(self, count: int, inputs: int, channels: int) -> None:
        super().__init__()
        self.count = count
        codes = 3 * len(sine_code(torch.zeros(())))
        self.position = nn.Sequential(nn.Linear(codes, channels), nn.ReLU(inplace=True), nn.Linear(channels, channels))
        self.seen = nn.Linear(inputs, channels)
        self.lies = nn.Linear(3, channels)  # score and heading
        self.norm = nn.LayerNorm(channels)

    def forward(
        self, shown: Float[Tensor, "m 6 h w"], feature: Float[Tensor, "m c h w"], batch: Batch, stride: int, space: SpaceRange
    ) -> Seeds:
        """The best cells of each sample. What the head predicts is taken as it is: no gradient goes back through it.

        Args:
            shown: output of the perspective head.
            feature: what it was predicted from.
            batch: cameras and BEV augmentation.
            stride: pixels per cell.
            space: range of the boxes, in the augmented ego frame.
        """
        with torch.autocast(feature.device.type, enabled=False):
            shown = shown.detach().float()
            points_ego, headings_ego = lift_perspective(shown, batch.cameras, stride)
            turn = batch.bev_from_ego[batch.sample_index].to(points_ego)
            place = space.normalise(torch.einsum("mij,mjhw->mhwi", turn, points_ego)).clamp(_EDGE, 1 - _EDGE)
            heading = F.normalize(torch.einsum("mij,mjhw->mhwi", turn[:, :2, :2], headings_ego), dim=-1)
            score = cell_scores(shown)
        cells = self._best(score, batch.sample_index, batch.num_samples)
        picked, lies = place.flatten(0, 2)[cells], torch.cat([heading, score[..., None]], dim=-1).flatten(0, 2)[cells]
        x, y, z = picked.unbind(-1)
        seen = feature.permute(0, 2, 3, 1).flatten(0, 2)[cells]
        return Seeds(
            picked,
            lies[..., (1, 0)],
            self.position(torch.cat([sine_code(y), sine_code(x), sine_code(z)], dim=-1)),
            self.norm(self.seen(seen) + self.lies(lies)),
        )

    def _best(self, score: Float[Tensor, "m h w"], sample_index: Int[Tensor, "m"], samples: int) -> Int[Tensor, "b p"]:
        """Indices into the cells of all cameras; samples with fewer cells than seeds repeat their last one."""
        index = torch.arange(score.numel(), device=score.device).reshape(score.shape)
        chosen = []
        for sample in range(samples):
            own = sample_index == sample
            best = torch.topk(score[own].flatten(), min(self.count, score[own].numel())).indices
            best = torch.cat([best, best[-1:].expand(self.count - len(best))])
            chosen.append(index[own].flatten()[best])
        return torch.stack(chosen)


def check_seeds(seeds: int, perspective_weight: float, is_released: bool) -> None:
    """For configurations.

    Raises:
        ValueError: seeds without a head that is trained to see objects, or in the frame of released weights.
    """
    if seeds < 0:
        raise ValueError(f"seeds is at least 0, got {seeds}")
    if seeds and not perspective_weight:
        raise ValueError("seeds of object queries come from the perspective head: give it a perspective_weight above 0")
    if seeds and is_released:
        raise ValueError("released weights have no seeds of object queries")


def cell_scores(shown: Float[Tensor, "m 6 h w"]) -> Float[Tensor, "m h w"]:
    """How likely each cell is the centre of an object: its cover, less with its distance from the centre it predicts.

    Cells beside a better one are put far back.
    """
    score = shown[:, 0].sigmoid() * torch.exp(-_CENTRE_SHARPNESS * shown[:, 1:3].square().sum(1))
    peak = F.max_pool2d(score[:, None], 3, stride=1, padding=1)[:, 0]
    return torch.where(score < peak, score * _BESIDE_A_PEAK, score)
