"""CenterPoint head: a heat map of box centres per class and regression maps (spec official_code 1.6)."""

from __future__ import annotations

from collections.abc import Mapping

from jaxtyping import Float
from torch import Tensor, nn

from coin3d.detectors.layers import conv_bn_relu

REGRESSIONS = {"offset": 2, "height": 1, "size": 3, "heading": 2}
"""Branch -> channels: offset inside the cell, z of the centre (m), log(l, w, h), (sin, cos) of the yaw."""

_HEATMAP_BIAS = -2.19  # sigmoid = 0.1, the usual prior of focal-loss heads


class CenterHead(nn.Module):
    """One shared convolution and a two-layer branch per output.

    Args:
        inputs: channels of the BEV feature.
        classes: number of classes (heat-map channels).
        channels: width of the head.
    """

    def __init__(self, inputs: int, classes: int, channels: int = 64) -> None:
        super().__init__()
        self.shared_conv = conv_bn_relu(inputs, channels)
        self.branches = output_branches(channels, {**REGRESSIONS, "heatmap": classes})

    def forward(self, bev: Float[Tensor, "b c y x"]) -> dict[str, Float[Tensor, "b k y x"]]:
        """Raw maps; ``heatmap`` holds logits."""
        shared = self.shared_conv(bev)
        return {name: branch(shared).float() for name, branch in self.branches.items()}


def output_branches(channels: int, outputs: Mapping[str, int]) -> nn.ModuleDict:
    """A two-layer branch per output, by name; ``heatmap`` starts at the usual prior."""
    branches = nn.ModuleDict()
    for name, count in outputs.items():
        branches[name] = nn.Sequential(conv_bn_relu(channels, channels), nn.Conv2d(channels, count, 3, padding=1))
    nn.init.constant_(branches["heatmap"][1].bias, _HEATMAP_BIAS)  # type: ignore[index]
    return branches
