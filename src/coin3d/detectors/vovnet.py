"""V2-99 image trunk: one-shot aggregation with a squeeze-and-excitation gate in every block (spec detectors 3.1).

timm's network of that name gates the last block of each stage only, so its weights and outputs are not the released ones.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from coin3d.detectors.layers import conv_bn_relu
from coin3d.detectors.widened_conv import WidenedConv2d

_STEM = ((64, 2), (64, 1), (128, 2))
"""Channels and stride of the first three convolutions."""
_STAGES = ((1, 128, 256), (3, 160, 512), (9, 192, 768), (3, 224, 1024))
"""Blocks, channels inside a block, channels out; the first stage has stride 4."""
_STAGE_STRIDES = (4, 8, 16, 32)
_BLOCK_LAYERS = 5


class VoVNet99(nn.Module):
    """Feature maps of several strides.

    Args:
        strides: which feature maps to return, finest first, out of 4, 8, 16, 32.
        extra_channels: input channels beyond RGB.

    Raises:
        ValueError: other strides.
    """

    def __init__(self, strides: Sequence[int] = (16, 32), extra_channels: int = 0) -> None:
        super().__init__()
        if not strides or set(strides) - set(_STAGE_STRIDES) or list(strides) != sorted(strides):
            raise ValueError(f"V2-99 gives feature maps of rising strides out of {_STAGE_STRIDES}, got {tuple(strides)}")
        self.strides = tuple(strides)
        self.channels = [_STAGES[_STAGE_STRIDES.index(s)][2] for s in strides]
        inputs, stem = 3, []
        for channels, stride in _STEM:
            stem.append(conv_bn_relu(inputs, channels, stride=stride))
            inputs = channels
        self.stem = nn.Sequential(*stem)
        self.stages = nn.ModuleList()
        for blocks, inner, outputs in _STAGES[: _STAGE_STRIDES.index(strides[-1]) + 1]:
            stage = [AggregationBlock(outputs if i else inputs, inner, outputs, residual=i > 0) for i in range(blocks)]
            self.stages.append(nn.Sequential(*stage))
            inputs = outputs
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight)
        if extra_channels:
            first = stem[0][0]
            assert isinstance(first, nn.Conv2d)
            stem[0][0] = WidenedConv2d(first, extra_channels)

    def forward(self, images: Float[Tensor, "m c h w"]) -> list[Tensor]:
        x = self.stem(images)
        features = []
        for stride, stage in zip(_STAGE_STRIDES, self.stages, strict=False):
            x = stage(x if stride == 4 else F.max_pool2d(x, 3, 2, ceil_mode=True))
            if stride in self.strides:
                features.append(x)
        return features


class AggregationBlock(nn.Module):
    """Five convolutions in a row, all their outputs and the input joined by one 1x1 convolution, then a gate per channel.

    Args:
        inputs: channels in.
        inner: channels of the five convolutions.
        outputs: channels out.
        residual: add the input to the output.
    """

    def __init__(self, inputs: int, inner: int, outputs: int, residual: bool) -> None:
        super().__init__()
        self.layers = nn.ModuleList(conv_bn_relu(inner if i else inputs, inner) for i in range(_BLOCK_LAYERS))
        self.join = conv_bn_relu(inputs + _BLOCK_LAYERS * inner, outputs, kernel=1)
        self.gate = nn.Conv2d(outputs, outputs, 1)
        self.residual = residual

    def forward(self, x: Float[Tensor, "m c h w"]) -> Float[Tensor, "m k h w"]:
        outputs = [x]
        for layer in self.layers:
            outputs.append(layer(outputs[-1]))
        joined = self.join(torch.cat(outputs, dim=1))
        gated: Tensor = joined * F.hardsigmoid(self.gate(joined.mean((2, 3), keepdim=True)))
        return gated + x if self.residual else gated
