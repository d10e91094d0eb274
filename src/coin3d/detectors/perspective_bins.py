"""A perspective head that tells distances as distributions, for detectors that take their first boxes from it.

A single number per cell settles between the distances it hesitates between. A distribution over bins of equal ratio keeps them
apart, its best bin is read off together with its neighbours, and how much of it lies there tells how far to trust the place.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from coin3d.detectors.layers import conv_bn_relu
from coin3d.detectors.perspective import PerspectiveTargets, scaled_log_distance

_NEAREST_M, _FARTHEST_M, _BINS = 3.0, 75.0, 40  # apparent distances, see perspective; a bin is a twelfth longer than the last
_READ_BINS = 2  # to either side of the best
_COVER_WEIGHT = 15.0


class BinnedPerspectiveHead(nn.Module):
    """Two 3x3 convolutions and an output layer.

    Args:
        inputs: channels of the neck's feature.
        channels: between the layers.
    """

    bins: Tensor

    def __init__(self, inputs: int, channels: int) -> None:
        super().__init__()
        self.convs = nn.Sequential(conv_bn_relu(inputs, channels), conv_bn_relu(channels, channels))
        self.output = nn.Conv2d(channels, 5 + _BINS, 1)
        ends = scaled_log_distance(_NEAREST_M), scaled_log_distance(_FARTHEST_M)
        self.register_buffer("bins", torch.linspace(*ends, _BINS), persistent=False)

    def forward(self, feature: Float[Tensor, "m c h w"]) -> Float[Tensor, "m 45 h w"]:
        """Cover logits, offset of the centre 2, heading 2, logits of the bins."""
        out: Tensor = self.output(self.convs(feature))
        return out

    def read(self, raw: Float[Tensor, "m 45 h w"]) -> tuple[Float[Tensor, "m 6 h w"], Float[Tensor, "m h w"]]:
        """What a ``PerspectiveHead`` would say, and the share of the distribution around the distance that is said."""
        raw = raw.float()
        probability = raw[:, 5:].softmax(1)
        index = torch.arange(_BINS, device=raw.device)[:, None, None]
        near = probability * ((index - probability.argmax(1, keepdim=True)).abs() <= _READ_BINS)
        sure = near.sum(1)
        distance = (near * self.bins[:, None, None]).sum(1) / sure
        return torch.cat([raw[:, :3], distance[:, None], raw[:, 3:5]], dim=1), sure

    def loss(self, raw: Float[Tensor, "m 45 h w"], targets: PerspectiveTargets) -> Float[Tensor, ""]:
        """As ``perspective_loss``, with a cross-entropy of the bins, softened to their neighbours, in place of the distance."""
        raw, wanted = raw.float(), targets.values
        cover = F.binary_cross_entropy_with_logits(raw[:, 0], targets.cover)
        error = (raw[:, 1:3] - wanted[:, :2]).abs().sum(1) + (raw[:, 3:5] - wanted[:, 3:]).abs().sum(1)
        steps = (wanted[:, 2:3] - self.bins[:, None, None]) / (self.bins[1] - self.bins[0])
        bins = -((-steps.square() / 2).softmax(1) * raw[:, 5:].log_softmax(1)).sum(1)
        shown = targets.object.sum().clamp(min=1)
        return _COVER_WEIGHT * cover + ((error + bins) * targets.object).sum() / shown
