"""Neck that brings every level to one resolution and concatenates them (SECOND's; spec detectors 1.3 and 1.11)."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn


class SecondFPN(nn.Module):
    """One branch per level, whose kernel is as large as its step: patches are folded up or spread out.

    Args:
        inputs: channels of each level.
        strides: of each level.
        stride: of the result. Finer levels are folded by a convolution, the others spread by its transpose (also where the
            factor is 1, as in the released weights).
        channels: of the result, an equal share from each level.

    Raises:
        ValueError: strides that no whole factor joins, or channels that cannot be shared.
    """

    def __init__(self, inputs: Sequence[int], strides: Sequence[int], stride: int, channels: int) -> None:
        super().__init__()
        if channels % len(inputs):
            raise ValueError(f"{channels} channels of a neck cannot be shared by {len(inputs)} levels")
        if any(max(s, stride) % min(s, stride) for s in strides):
            raise ValueError(f"levels of strides {tuple(strides)} do not meet at stride {stride} by whole factors")
        share = channels // len(inputs)
        self.branches = nn.ModuleList()
        for level, level_stride in zip(inputs, strides, strict=True):
            step = max(level_stride, stride) // min(level_stride, stride)
            kind = nn.Conv2d if level_stride < stride else nn.ConvTranspose2d
            norm = nn.BatchNorm2d(share, eps=1e-3, momentum=0.01)
            self.branches.append(nn.Sequential(kind(level, share, step, step, bias=False), norm, nn.ReLU(inplace=True)))

    def forward(self, features: Sequence[Tensor]) -> Tensor:
        return torch.cat([branch(x) for branch, x in zip(self.branches, features, strict=True)], dim=1)
