"""Convolution whose kernel reads from places it predicts (deformable convolution, first version)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torchvision.ops import deform_conv2d


class DeformableConv(nn.Module):
    """3x3 convolution that keeps size and channels; each tap is moved by an offset learned from the same input.

    Args:
        channels: in and out.
        groups: the channels are convolved in so many separate groups; all share the offsets.
    """

    def __init__(self, channels: int, groups: int = 1) -> None:
        super().__init__()
        like = nn.Conv2d(channels, channels, 3, padding=1, groups=groups, bias=False)
        self.weight = nn.Parameter(like.weight.detach().clone())
        self.offset = nn.Conv2d(channels, 2 * 9, 3, padding=1)
        nn.init.zeros_(self.offset.weight)  # starts as the plain convolution
        nn.init.zeros_(self.offset.bias)  # type: ignore[arg-type]

    def forward(self, x: Float[Tensor, "m c h w"]) -> Float[Tensor, "m c h w"]:
        # an offset that is not a number would make torchvision read outside of the image; the output is NaN all the same
        offset = torch.nan_to_num(self.offset(x))
        out: Tensor = deform_conv2d(x, offset.to(x.dtype), self.weight.to(x.dtype), padding=1)
        return out
