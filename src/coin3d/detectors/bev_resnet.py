"""Bird's-eye-view encoder of Megvii's BEVDepth: a small ResNet whose levels are concatenated (spec detectors 1.11)."""

from __future__ import annotations

from collections.abc import Sequence

from jaxtyping import Float
from torch import Tensor, nn

from coin3d.detectors.layers import BasicBlock
from coin3d.detectors.second_fpn import SecondFPN


class BevResNet(nn.Module):
    """Features at the resolution of the input grid.

    Args:
        inputs: channels of the pooled BEV.
        stages: channels of the residual stages; the stem halves the resolution, every stage but the first halves it again.
        outputs: channels of the result.
    """

    def __init__(self, inputs: int, stages: Sequence[int], outputs: int) -> None:
        super().__init__()
        first = stages[0]
        self.stem = nn.Sequential(nn.Conv2d(inputs, first, 7, 2, 3, bias=False), nn.BatchNorm2d(first), nn.ReLU(inplace=True))
        self.stages = nn.ModuleList()
        channels = first
        for i, wider in enumerate(stages):
            shortcut = None if i == 0 else nn.Sequential(nn.Conv2d(channels, wider, 1, 2, bias=False), nn.BatchNorm2d(wider))
            halving = BasicBlock(channels, wider, 1 if i == 0 else 2, shortcut)
            self.stages.append(nn.Sequential(halving, BasicBlock(wider, wider)))
            channels = wider
        strides = [1, *(2 ** (i + 1) for i in range(len(stages)))]
        self.neck = SecondFPN([inputs, *stages], strides, 1, outputs)

    def forward(self, bev: Float[Tensor, "b c y x"]) -> Float[Tensor, "b k y x"]:
        levels, x = [bev], self.stem(bev)
        for stage in self.stages:
            x = stage(x)
            levels.append(x)
        out: Tensor = self.neck(levels)
        return out
