"""Object queries that start from boxes a dense head sees, beside those that are learned.

A learned query starts anywhere and has to find its object through attention that is yet to be learned; from random weights that
takes days. A head that is told what every cell shows is right after minutes. Its best cells become queries which start at the
place it sees, with the cell's feature, and the decoder corrects its boxes: the hybrid queries of BEVFormer v2, the heat-map
queries of TransFusion. No released weights have them.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from coin3d.detectors.batch import Batch
from coin3d.detectors.lift_splat import BevGrid
from coin3d.detectors.object_queries import PRIOR_LOGIT, ObjectQueries
from coin3d.detectors.perspective import lift_perspective
from coin3d.detectors.position_embedding_3d import sine_code
from coin3d.detectors.query_boxes import HEADING, PLACE, VELOCITY
from coin3d.detectors.space_range import SpaceRange

_CENTRE_SHARPNESS = 4.0  # a cell beside that of the centre counts exp(-1)
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


def perspective_boxes(
    shown: Float[Tensor, "m 6 h w"],
    sure: Float[Tensor, "m h w"],
    feature: Float[Tensor, "m f h w"],
    batch: Batch,
    stride: int,
    count: int,
    classes: int,
) -> FirstBoxes:
    """The best cells of a perspective head, which knows neither sizes nor classes.

    Args:
        shown: what it says.
        sure: how far to trust its distances, 0..1.
        feature: what it was predicted from.
        batch: cameras and BEV augmentation.
        stride: pixels per cell.
        count: boxes of each sample; samples with fewer cells repeat their last one.
        classes: all get the same score.
    """
    with torch.autocast(feature.device.type, enabled=False):
        shown = shown.detach().float()
        points_ego, headings_ego = lift_perspective(shown, batch.cameras, stride)
        turn = batch.bev_from_ego[batch.sample_index].to(points_ego)
        points = torch.einsum("mij,mjhw->mhwi", turn, points_ego)
        cosine, sine = F.normalize(torch.einsum("mij,mjhw->mhwi", turn[:, :2, :2], headings_ego), dim=-1).unbind(-1)
        x, y, z = points.unbind(-1)
        unknown = torch.zeros_like(x)
        code = torch.stack([x, y, unknown, unknown, z, unknown, sine, cosine, unknown, unknown], dim=-1)
        score = cell_scores(shown) * sure
    cells = _best_cells(score, batch.sample_index, batch.num_samples, count)
    return FirstBoxes(
        code.flatten(0, 2)[cells],
        score.flatten()[cells][..., None].expand(-1, -1, classes),
        feature.permute(0, 2, 3, 1).flatten(0, 2)[cells],
    )


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


def cell_scores(shown: Float[Tensor, "m 6 h w"]) -> Float[Tensor, "m h w"]:
    """How likely each image cell is the centre of an object: its cover, less with its distance from the centre it predicts.

    Cells beside a better one are put far back.
    """
    return _peaks(shown[:, :1].sigmoid() * torch.exp(-_CENTRE_SHARPNESS * shown[:, 1:3].square().sum(1, keepdim=True)))[:, 0]


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


def _best_cells(score: Float[Tensor, "m h w"], sample_index: Int[Tensor, "m"], samples: int, count: int) -> Int[Tensor, "b p"]:
    index = torch.arange(score.numel(), device=score.device).reshape(score.shape)
    chosen = []
    for sample in range(samples):
        own = sample_index == sample
        best = torch.topk(score[own].flatten(), min(count, score[own].numel())).indices
        best = torch.cat([best, best[-1:].expand(count - len(best))])
        chosen.append(index[own].flatten()[best])
    return torch.stack(chosen)
