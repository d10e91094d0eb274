"""First boxes of a perspective head: every cell that shows an object votes for where its centre is.

A single cell tells the distance of an object to within some per cent, and the centre of an object that stands behind another
has no cell of its own. All cells that show an object, together, tell its place better, also where only its side looks out:
their votes are summed on the ground, and places where more votes meet than anywhere near become boxes (mean shift, one step).
"""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn import functional as F  # noqa: N812

from coin3d.detectors.batch import Batch
from coin3d.detectors.object_seeds import FirstBoxes
from coin3d.detectors.perspective import lift_perspective

_VOTERS = 400
_MEETING_M = 0.7  # votes nearer than this count as the same place
_APART_M = 1.5  # of two places nearer than this, the one with fewer votes only fills up
_FILLS_UP = 0.01
_FAR_CELLS_COUNT_LESS = 0.5  # two cells from the centre it votes for, a cell counts exp(-0.5)


def perspective_boxes(
    shown: Float[Tensor, "m 6 h w"],
    sure: Float[Tensor, "m h w"],
    feature: Float[Tensor, "m f h w"],
    batch: Batch,
    stride: int,
    count: int,
    classes: int,
) -> FirstBoxes:
    """The places most cells vote for; a perspective head knows neither sizes nor classes.

    Args:
        shown: what it says.
        sure: how far to trust its distances, 0..1.
        feature: what it was predicted from; a box has the mean of its voters, the only part gradients go through.
        batch: cameras and BEV augmentation.
        stride: pixels per cell.
        count: boxes of each sample; samples with fewer voters repeat their last one.
        classes: all get the same score.
    """
    with torch.autocast(feature.device.type, enabled=False):
        shown = shown.detach().float()
        weight = voting_weights(shown) * sure
        places_ego, headings_ego = lift_perspective(shown, batch.cameras, stride)
        turn = batch.bev_from_ego[batch.sample_index].to(places_ego)
        places = torch.einsum("mij,mjhw->mhwi", turn, places_ego).flatten(0, 2)
        headings = F.normalize(torch.einsum("mij,mjhw->mhwi", turn[:, :2, :2], headings_ego), dim=-1).flatten(0, 2)
        features = feature.float().permute(0, 2, 3, 1).flatten(0, 2)
        index = torch.arange(weight.numel(), device=weight.device).reshape(weight.shape)
        found = []
        for sample in range(batch.num_samples):
            own = batch.sample_index == sample
            best = torch.topk(weight[own].flatten(), min(_VOTERS, weight[own].numel()))
            voters: Int[Tensor, "v"] = index[own].flatten()[best.indices]
            found.append(_most_voted(places[voters], headings[voters], best.values, features[voters], count))
        place, heading, score, mean_feature = (torch.stack(parts) for parts in zip(*found, strict=True))
        x, y, z = place.unbind(-1)
        cosine, sine = heading.unbind(-1)
        unknown = torch.zeros_like(x)
        code = torch.stack([x, y, unknown, unknown, z, unknown, sine, cosine, unknown, unknown], dim=-1)
    return FirstBoxes(code, score[..., None].expand(-1, -1, classes), mean_feature.to(feature.dtype))


def voting_weights(shown: Float[Tensor, "m 6 h w"]) -> Float[Tensor, "m h w"]:
    """How much a cell's vote counts: its cover, less with its distance from the centre it predicts."""
    return shown[:, 0].sigmoid() * torch.exp(-_FAR_CELLS_COUNT_LESS * shown[:, 1:3].square().sum(1))


def _most_voted(
    places: Float[Tensor, "v 3"],
    headings: Float[Tensor, "v 2"],
    weights: Float[Tensor, "v"],
    features: Float[Tensor, "v f"],
    count: int,
) -> tuple[Float[Tensor, "p 3"], Float[Tensor, "p 2"], Float[Tensor, "p"], Float[Tensor, "p f"]]:
    """Place, heading, score 0..1 and mean feature of the best ``count`` meetings of votes, best first."""
    together = weights * torch.exp(-_squared_distances(places) / (2 * _MEETING_M**2))
    votes = together.sum(1)
    shares = together / votes.clamp(min=torch.finfo(votes.dtype).tiny)[:, None]
    met = shares @ places
    rank = torch.argsort(torch.argsort(votes, descending=True, stable=True))  # of equals, the first is the better
    better_near = (_squared_distances(met) < _APART_M**2) & (rank < rank[:, None])
    score = votes / (1 + votes)
    best = torch.topk(torch.where(better_near.any(1), score * _FILLS_UP, score), min(count, len(score)))
    rows = torch.cat([best.indices, best.indices[-1:].expand(count - len(best.indices))])
    scores = torch.cat([best.values, best.values[-1:].expand(count - len(best.values))])
    return met[rows], F.normalize(shares[rows] @ headings, dim=-1), scores, shares[rows] @ features


def _squared_distances(places: Float[Tensor, "v 3"]) -> Float[Tensor, "v v"]:
    x, y = places[:, 0], places[:, 1]
    return (x[:, None] - x).square() + (y[:, None] - y).square()
