"""Top-down feature pyramid that returns its finest level only (spec official_code 1.2)."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812


class FeaturePyramid(nn.Module):
    """1x1 laterals, nearest upsampling and addition, one 3x3 convolution at the finest level.

    Args:
        inputs: channels of each level, finest first.
        channels: output channels.
    """

    def __init__(self, inputs: Sequence[int], channels: int) -> None:
        super().__init__()
        self.lateral_convs = nn.ModuleList(nn.Conv2d(c, channels, 1) for c in inputs)
        self.out_conv = nn.Conv2d(channels, channels, 3, padding=1)

    def forward(self, features: Sequence[Tensor]) -> Tensor:
        laterals = [conv(x) for conv, x in zip(self.lateral_convs, features, strict=True)]
        merged = laterals[-1]
        for finer in reversed(laterals[:-1]):
            merged = finer + F.interpolate(merged, size=finer.shape[-2:], mode="nearest")
        out: Tensor = self.out_conv(merged)
        return out
