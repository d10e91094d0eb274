"""Spatial-aware feature modulation: the prior maps enter the features (paper eq. M_invF and M_MixPriorProj)."""

from __future__ import annotations

from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn

from coin3d.priors.channels import INVERSE_FOCAL, PriorSet

Projector = Literal["conv1", "conv1+conv1", "conv3", "conv3+conv3"]
"""The projector variants of the paper's ablation: 1x1 or 3x3 convolutions without bias, each followed by a ReLU."""


class SpatialModulation(nn.Module):
    """F -> cat(F * M_IF + projector(cat(M_GD, M_GG, M_PR)), priors).

    Args:
        channels: channels C of the features.
        priors: which priors are used, all by default; without inverse focal there is no multiplication.
        projector: see ``Projector``; the paper's choice is one 3x3 convolution.
        modulate: ``False`` only concatenates the priors.
    """

    def __init__(
        self,
        channels: int,
        priors: PriorSet | None = None,
        projector: Projector = "conv3",
        modulate: bool = True,
    ) -> None:
        super().__init__()
        self.priors = priors = priors or PriorSet()
        self.modulate = modulate
        self.out_channels = channels + len(priors.channels)
        embedded = len(priors.embedded)
        self.projector = _projector(embedded, channels, projector) if modulate and embedded else None

    def forward(self, features: Float[Tensor, "m c h w"], prior: Float[Tensor, "m 9 h w"]) -> Float[Tensor, "m c_plus_k h w"]:
        """Modulate features of M cameras by their nine prior channels at the same resolution."""
        prior = prior.to(features.dtype)
        out = features
        if self.modulate and self.priors.inverse_focal:
            out = out * prior[:, INVERSE_FOCAL : INVERSE_FOCAL + 1]
        if self.projector is not None:
            out = out + self.projector(prior[:, list(self.priors.embedded)])
        beside = prior[:, list(self.priors.channels)]
        if features.is_contiguous(memory_format=torch.channels_last):  # or all features would be copied into another layout
            beside = beside.contiguous(memory_format=torch.channels_last)
        return torch.cat([out, beside], dim=1)


def _projector(in_channels: int, channels: int, projector: Projector) -> nn.Sequential:
    kernels = {"conv1": [1], "conv1+conv1": [1, 1], "conv3": [3], "conv3+conv3": [3, 3]}
    if projector not in kernels:
        raise ValueError(f"the projector is one of {', '.join(kernels)}, got {projector!r}")
    layers: list[nn.Module] = []
    for kernel in kernels[projector]:
        layers += [nn.Conv2d(in_channels, channels, kernel, padding=kernel // 2, bias=False), nn.ReLU(inplace=True)]
        in_channels = channels
    return nn.Sequential(*layers)
