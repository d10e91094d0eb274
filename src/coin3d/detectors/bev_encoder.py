"""Bird's-eye-view encoder: three residual stages and a two-scale neck (spec official_code 1.5)."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from coin3d.detectors.layers import BasicBlock, conv_bn_relu


class BevEncoder(nn.Module):
    """Features at the resolution of the input grid or half of it.

    Args:
        inputs: channels of the pooled BEV.
        stages: channels of the three stages; each halves the resolution.
        outputs: channels of the result.
        out_stride: cells of the input grid per cell of the result, 1 (as released) or 2.
    """

    def __init__(self, inputs: int, stages: Sequence[int], outputs: int, out_stride: int = 1) -> None:
        super().__init__()
        if len(stages) != 3:
            raise ValueError(f"the BEV encoder has three stages, got {len(stages)} channel counts")
        self.stages = nn.ModuleList()
        for channels in stages:
            self.stages.append(residual_stage(inputs, channels, 2, 2))
            inputs = channels
        self.lift_coarse = nn.Upsample(scale_factor=4, mode="bilinear", align_corners=True)
        self.merge = nn.Sequential(conv_bn_relu(stages[0] + stages[2], 2 * outputs), conv_bn_relu(2 * outputs, 2 * outputs))
        self.lift_fine = nn.Sequential(
            nn.Upsample(scale_factor=2 // out_stride, mode="bilinear", align_corners=True),
            conv_bn_relu(2 * outputs, outputs),
            nn.Conv2d(outputs, outputs, 1),
        )

    def forward(self, bev: Float[Tensor, "b c y x"]) -> Float[Tensor, "b k y2 x2"]:
        levels = []
        for stage in self.stages:
            bev = stage(bev)
            levels.append(bev)
        merged = self.merge(torch.cat([levels[0], self.lift_coarse(levels[2])], dim=1))
        out: Tensor = self.lift_fine(merged)
        return out


def residual_stage(inputs: int, channels: int, stride: int, blocks: int) -> nn.Sequential:
    """Residual blocks of which the first has a plain convolution, with bias and without norm, beside it."""
    first = BasicBlock(inputs, channels, stride, nn.Conv2d(inputs, channels, 3, stride, 1))
    return nn.Sequential(first, *(BasicBlock(channels, channels) for _ in range(blocks - 1)))
