"""One query per object: Hungarian matching, then focal and L1 losses, after every decoder layer (spec detectors 2, losses)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment
from torch import Tensor
from torch.nn import functional as F  # noqa: N812

from coin3d.detectors.query_boxes import CODE_SIZE, HEADING, VELOCITY, encode_boxes
from coin3d.detectors.space_range import SpaceRange
from coin3d.geometry import Boxes3D

_ALPHA = 0.25
_LOG_EPSILON = 1e-12
_COST_OF_NAN = 100.0


@dataclass(frozen=True)
class QueryLossWeights:
    """Weights of the losses, which are also those of the matching costs.

    Args:
        classes: of the focal loss.
        box: of the L1 loss.
        heading: of sine and cosine of the yaw within it, not in the matching. A shift in logits moves a box by tens of
            metres: next to such gradients those of the heading count for little, and it is learned late.
        velocity: of the two velocities within it; they take no part in the matching. 0 leaves them untrained.
    """

    classes: float = 2.0
    box: float = 0.25
    heading: float = 1.0
    velocity: float = 0.2


@dataclass(frozen=True, eq=False)
class QueryTargets:
    """Ground truth of one sample.

    Args:
        labels: (N,) class indices.
        codes: (N, 10) see query_boxes; NaN where unknown.
    """

    labels: Int[Tensor, "n"]
    codes: Float[Tensor, "n 10"]

    def to(self, device: torch.device | str) -> QueryTargets:
        return QueryTargets(self.labels.to(device), self.codes.to(device))


def query_targets(boxes: Boxes3D, classes: Sequence[str], space: SpaceRange) -> QueryTargets:
    """Encode the ground truth of a sample, in the frame the detector predicts in.

    Boxes of other classes and boxes whose centre no query can reach are left out.
    """
    unit = space.normalise(torch.from_numpy(boxes.centre_m))
    reachable = ((unit > 0) & (unit < 1)).all(1).numpy()
    known = [i for i, label in enumerate(boxes.labels.tolist()) if label in classes and reachable[i]]
    labels = [classes.index(str(boxes.labels[i])) for i in known]
    return QueryTargets(torch.tensor(labels, dtype=torch.long), encode_boxes(boxes)[known])


def query_losses(
    class_logits: Float[Tensor, "l b q k"],
    codes: Float[Tensor, "l b q 10"],
    targets: Sequence[QueryTargets],
    weights: QueryLossWeights,
) -> dict[str, Float[Tensor, ""]]:
    """``class_<layer>`` and ``box_<layer>`` for each decoder layer, counted from 1.

    Args:
        class_logits: L layers, B samples, Q queries.
        codes: placed boxes.
        targets: B samples.
        weights: of the parts.
    """
    losses = {}
    for layer, (logits, boxes) in enumerate(zip(class_logits.float(), codes.float(), strict=True), start=1):
        losses[f"class_{layer}"], losses[f"box_{layer}"] = _layer_losses(logits, boxes, targets, weights)
    return losses


def match(
    class_logits: Float[Tensor, "q k"], codes: Float[Tensor, "q 10"], targets: QueryTargets, weights: QueryLossWeights
) -> tuple[Int[Tensor, "p"], Int[Tensor, "p"]]:
    """The cheapest pairing of queries with objects: their indices, pair by pair, rising queries."""
    probability = class_logits.detach().float().sigmoid()
    hit = -(probability + _LOG_EPSILON).log() * _ALPHA * (1 - probability) ** 2
    miss = -(1 - probability + _LOG_EPSILON).log() * (1 - _ALPHA) * probability**2
    geometry = slice(0, VELOCITY.start)
    distance = torch.cdist(codes.detach().float()[:, geometry], targets.codes[:, geometry], p=1)
    cost = weights.classes * (hit - miss)[:, targets.labels] + weights.box * distance
    # a diverging network is reported by its loss; the assignment itself refuses numbers that are not finite
    finite = cost.nan_to_num(_COST_OF_NAN, _COST_OF_NAN, -_COST_OF_NAN)
    query, target = linear_sum_assignment(finite.cpu().numpy())
    device = class_logits.device
    return torch.as_tensor(query, device=device), torch.as_tensor(target, device=device)


def _layer_losses(
    logits: Float[Tensor, "b q k"], codes: Float[Tensor, "b q 10"], targets: Sequence[QueryTargets], weights: QueryLossWeights
) -> tuple[Float[Tensor, ""], Float[Tensor, ""]]:
    wanted, matched, goals = torch.zeros_like(logits), [], []
    for b, target in enumerate(targets):
        query, row = match(logits[b], codes[b], target, weights)
        wanted[b, query, target.labels[row]] = 1
        matched.append(codes[b, query])
        goals.append(target.codes[row])
    predicted, goal = torch.cat(matched), torch.cat(goals)
    objects = max(1, len(goal))
    importance = goal.new_ones(CODE_SIZE)
    importance[HEADING] = weights.heading
    importance[VELOCITY] = weights.velocity
    known = goal.isfinite()
    error = (predicted - goal.where(known, predicted.detach())).abs() * importance
    return (
        weights.classes * sigmoid_focal_loss(logits, wanted).sum() / objects,
        weights.box * error.sum() / objects,
    )


def sigmoid_focal_loss(logits: Float[Tensor, "..."], wanted: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """Focal loss of independent classes (alpha 0.25, gamma 2), elementwise."""
    probability = logits.sigmoid()
    missing = torch.where(wanted > 0, 1 - probability, probability)
    balance = torch.where(wanted > 0, _ALPHA, 1 - _ALPHA)
    return balance * missing**2 * F.binary_cross_entropy_with_logits(logits, wanted, reduction="none")
