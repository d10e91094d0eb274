"""Refinement of lifted features before they are pooled (BEVDepth's depth aggregation; spec detectors 1.9)."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor, nn

from coin3d.detectors.layers import conv_bn_relu


class DepthAggregation(nn.Module):
    """Convolutions over columns and depths: each row of image cells is an image of its own, columns down, depths across."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.reduce = conv_bn_relu(channels, channels)
        self.refine = nn.Sequential(conv_bn_relu(channels, channels), conv_bn_relu(channels, channels))
        self.out = nn.Conv2d(channels, channels, 3, padding=1)

    def forward(self, depth: Float[Tensor, "m d h w"], context: Float[Tensor, "m c h w"]) -> Float[Tensor, "m h w d c"]:
        """Features of every (cell, depth): context weighted by probability, refined."""
        m, d, h, w = depth.shape
        lifted = depth.permute(0, 2, 3, 1)[:, :, None] * context.permute(0, 2, 1, 3)[..., None]  # (m, h, c, w, d)
        x = self.reduce(lifted.reshape(m * h, -1, w, d))
        out: Tensor = self.out(x + self.refine(x))
        return out.float().reshape(m, h, -1, w, d).permute(0, 1, 3, 4, 2)
