"""Image trunk: a timm ResNet whose first convolution may take prior maps beside RGB."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import timm
from jaxtyping import Float
from torch import Tensor, nn

from coin3d.detectors.widened_conv import WidenedConv2d

_STRIDES = (2, 4, 8, 16, 32)


class ImageBackbone(nn.Module):
    """Feature maps of several strides.

    Args:
        name: a timm ResNet ("resnet18", "resnet50", ...).
        strides: which feature maps to return, finest first.
        extra_channels: input channels beyond RGB.
        pretrained: start from timm's ImageNet weights (downloads them).
        blocks: residual blocks of each of the four stages, if not the named network's own.
    """

    def __init__(
        self,
        name: str,
        strides: Sequence[int],
        extra_channels: int = 0,
        pretrained: bool = False,
        blocks: tuple[int, ...] = (),
    ) -> None:
        super().__init__()
        wrong = [s for s in strides if s not in _STRIDES]
        if wrong or list(strides) != sorted(strides):
            raise ValueError(f"backbone strides are rising values out of {_STRIDES}, got {tuple(strides)}")
        indices = tuple(_STRIDES.index(s) for s in strides)
        changed: dict[str, Any] = {"layers": blocks} if blocks else {}
        trunk: Any = timm.create_model(name, pretrained=pretrained, features_only=True, out_indices=indices, **changed)
        self.channels: list[int] = trunk.feature_info.channels()
        if extra_channels:
            trunk.conv1 = WidenedConv2d(trunk.conv1, extra_channels)
        self.trunk = trunk

    def forward(self, images: Float[Tensor, "m c h w"]) -> list[Tensor]:
        features: list[Tensor] = self.trunk(images)
        return features
