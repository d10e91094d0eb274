"""How far away image cells are, as a distribution that LiDAR teaches, and how well points in space agree with it.

Without it a bird's-eye-view query sees the same image feature from everywhere along a ray and has to tell by the feature which
place is meant. Weighting its looks by this distribution is the depth consistency of FB-BEV. No released weights have it.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from coin3d.detectors.layers import conv_bn_relu
from coin3d.detectors.lift_splat import DepthBins


class DepthHead(nn.Module):
    """Depth logits from the neck's feature: a 3x3 convolution and an output layer.

    Args:
        inputs: channels of the feature.
        channels: of the layer between.
        bins: of the depth.
    """

    def __init__(self, inputs: int, channels: int, bins: DepthBins) -> None:
        super().__init__()
        self.conv = conv_bn_relu(inputs, channels)
        self.output = nn.Conv2d(channels, bins.count, 1)

    def forward(self, feature: Float[Tensor, "m c h w"]) -> Float[Tensor, "m d h w"]:
        """Logits, in float32: a softmax over many bins collapses in half precision."""
        out: Tensor = self.output(self.conv(feature)).float()
        return out


def depth_agreement(
    probability: Float[Tensor, "m d h w"],
    references: Float[Tensor, "m s a 2"],
    depth_m: Float[Tensor, "m s a"],
    bins: DepthBins,
) -> Float[Tensor, "m s a"]:
    """Probability of the depth of points at the cells they fall on, linear between cells and between bins.

    Args:
        probability: distribution of each cell.
        references: the points in the image, 0 and 1 being its edges.
        depth_m: their depths.
        bins: of the distribution; depths beyond them get 0.
    """
    along = (depth_m - bins.min_m) / (bins.max_m - bins.min_m)
    place = 2 * torch.cat([references, along[..., None]], dim=-1) - 1
    sampled = F.grid_sample(probability[:, None], place[:, :, :, None].to(probability.dtype), align_corners=False)
    return sampled[:, 0, :, :, 0]
