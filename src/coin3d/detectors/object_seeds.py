"""Object queries that start from boxes a dense head sees, beside those that are learned.

A learned query starts anywhere and has to find its object through attention that is yet to be learned; from random weights that
takes days. A head that is told what every cell shows is right after minutes. Its best cells become queries which start at the
place it sees, with the cell's feature, and the decoder corrects its boxes: the hybrid queries of BEVFormer v2, the heat-map
queries of TransFusion. No released weights have them.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from coin3d.detectors.lift_splat import BevGrid
from coin3d.detectors.object_queries import PRIOR_LOGIT, ObjectQueries
from coin3d.detectors.position_embedding_3d import sine_code
from coin3d.detectors.query_boxes import HEADING, PLACE, VELOCITY
from coin3d.detectors.space_range import SpaceRange

_BESIDE_A_PEAK = 0.01  # such cells only fill up
_EDGE = 0.005  # places keep clear of the ends of the range, where shifts in logits move nothing
_SUREST = 1e-3  # no score is taken to be closer to 0 or 1


@dataclass(frozen=True, eq=False)
class FirstBoxes:
    """The best P cells of each sample.

    Args:
        code: (B, P, 10) boxes in the frame the detector predicts in (see query_boxes).
        score: (B, P, K) of each class.
        feature: (B, P, F) of the cells.
    """

    code: Float[Tensor, "b p 10"]
    score: Float[Tensor, "b p k"]
    feature: Float[Tensor, "b p f"]


class ObjectSeeds(nn.Module):
    """Object queries from first boxes. Those are taken as they are: no gradient goes back through them, only through features.

    Args:
        inputs: F, channels of the features.
        channels: C, of the queries.
        classes: K.
    """

    def __init__(self, inputs: int, channels: int, classes: int) -> None:
        super().__init__()
        codes = 3 * len(sine_code(torch.zeros(())))
        self.position = nn.Sequential(nn.Linear(codes, channels), nn.ReLU(inplace=True), nn.Linear(channels, channels))
        self.seen = nn.Linear(inputs, channels)
        self.lies = nn.Linear(2 + classes, channels)
        self.norm = nn.LayerNorm(channels)

    def forward(self, first: FirstBoxes, space: SpaceRange) -> ObjectQueries:
        """A query for each box."""
        with torch.autocast(first.code.device.type, enabled=False):
            code, score = first.code.detach().float(), first.score.detach().float().clamp(_SUREST, 1 - _SUREST)
            place = space.normalise(code[..., PLACE]).clamp(_EDGE, 1 - _EDGE)
            start = code.clone()
            start[..., (*PLACE, VELOCITY.start, VELOCITY.stop - 1)] = 0
            x, y, z = place.unbind(-1)
            position = torch.cat([sine_code(y), sine_code(x), sine_code(z)], dim=-1)
        content = self.norm(self.seen(first.feature) + self.lies(torch.cat([code[..., HEADING], score], dim=-1)))
        return ObjectQueries(place, self.position(position), content, start, score.logit() - PRIOR_LOGIT)


def centre_boxes(
    maps: dict[str, Float[Tensor, "b _ y x"]], bev: Float[Tensor, "b f y x"], grid: BevGrid, count: int
) -> FirstBoxes:
    """The best cells of a ``CenterHead``.

    Args:
        maps: its outputs.
        bev: what they were predicted from.
        grid: cells.
        count: boxes of each sample.
    """
    with torch.autocast(bev.device.type, enabled=False):
        score = _peaks(maps["heatmap"].detach().float().sigmoid())
        column = torch.arange(grid.side, device=bev.device)
        x = (maps["offset"][:, 0] + column) * grid.cell_m - grid.half_extent_m
        y = (maps["offset"][:, 1] + column[:, None]) * grid.cell_m - grid.half_extent_m
        length, width, height = maps["size"].unbind(1)
        sine, cosine = F.normalize(maps["heading"], dim=1).unbind(1)
        still = torch.zeros_like(x)
        code = torch.stack([x, y, length, width, maps["height"][:, 0], height, sine, cosine, still, still], dim=-1)
    cells = torch.topk(score.amax(1).flatten(1), count).indices

    def at(values: Float[Tensor, "b y x k"]) -> Float[Tensor, "b p k"]:
        flat = values.flatten(1, 2)
        return torch.gather(flat, 1, cells[..., None].expand(-1, -1, flat.shape[-1]))

    return FirstBoxes(at(code), at(score.permute(0, 2, 3, 1)), at(bev.permute(0, 2, 3, 1)))


def check_seeds(seeds: int, dense_weight: float, is_released: bool) -> None:
    """For configurations.

    Raises:
        ValueError: seeds without a head that is trained to see objects, or together with released weights.
    """
    if seeds < 0:
        raise ValueError(f"seeds is at least 0, got {seeds}")
    if seeds and not dense_weight:
        raise ValueError("seeds of object queries come from a dense head: give its loss a weight above 0")
    if seeds and is_released:
        raise ValueError("released weights have no seeds of object queries")


def _peaks(score: Float[Tensor, "b k h w"]) -> Float[Tensor, "b k h w"]:
    best_around = F.max_pool2d(score, 3, stride=1, padding=1)
    return torch.where(score < best_around, score * _BESIDE_A_PEAK, score)
