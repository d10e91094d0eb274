"""Supervision of a depth distribution by LiDAR."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F  # noqa: N812

from coin3d.detectors.lift_splat import DepthBins


def depth_loss(
    depth_logits: Float[Tensor, "m d h w"], depth_m: Float[Tensor, "m H W"], bins: DepthBins, stride: int, weight: float = 3.0
) -> Float[Tensor, ""]:
    """Binary cross-entropy of the depth distribution against the nearest LiDAR return of each cell, per supervised cell."""
    known = torch.where(depth_m > 0, depth_m, torch.inf)
    nearest = -F.max_pool2d(-known[:, None], stride)[:, 0]
    index = bins.index(torch.where(nearest.isinf(), 0.0, nearest))
    supervised = index >= 0
    probability = depth_logits.float().softmax(dim=1).permute(0, 2, 3, 1)[supervised]
    one_hot = F.one_hot(index[supervised], bins.count).float()
    total = F.binary_cross_entropy(probability.clamp(0, 1), one_hot, reduction="sum")
    return weight * total / max(1, int(supervised.sum()))
