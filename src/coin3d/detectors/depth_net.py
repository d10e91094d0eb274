"""Depth distribution and context feature of every image cell (BEVDepth; spec official_code 1.3, detectors 1.4)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from coin3d.detectors.deformable_conv import DeformableConv
from coin3d.detectors.layers import BasicBlock, conv_bn_relu


class CameraGate(nn.Module):
    """BEVDepth's camera-aware squeeze-and-excitation: channel gates computed from the camera vector alone."""

    def __init__(self, vector_channels: int, channels: int) -> None:
        super().__init__()
        self.mlp = nn.Sequential(nn.Linear(vector_channels, channels), nn.ReLU(inplace=True), nn.Linear(channels, channels))
        self.reduce = nn.Conv2d(channels, channels, 1)
        self.expand = nn.Conv2d(channels, channels, 1)

    def forward(self, x: Float[Tensor, "m c h w"], vector: Float[Tensor, "m k"]) -> Float[Tensor, "m c h w"]:
        gate = self.expand(F.relu(self.reduce(self.mlp(vector)[..., None, None])))
        return x * torch.sigmoid(gate)


class DilatedContext(nn.Module):
    """Atrous spatial pyramid pooling: four dilations and a global average, concatenated and mixed."""

    def __init__(self, channels: int, branch_channels: int, dropout: float) -> None:
        super().__init__()
        self.branches = nn.ModuleList([conv_bn_relu(channels, branch_channels, 1)])
        for dilation in (6, 12, 18):
            self.branches.append(
                nn.Sequential(
                    nn.Conv2d(channels, branch_channels, 3, padding=dilation, dilation=dilation, bias=False),
                    nn.BatchNorm2d(branch_channels),
                    nn.ReLU(inplace=True),
                )
            )
        self.global_branch = nn.Sequential(nn.AdaptiveAvgPool2d(1), conv_bn_relu(channels, branch_channels, 1))
        self.mix = nn.Sequential(conv_bn_relu(5 * branch_channels, channels, 1), nn.Dropout(dropout))

    def forward(self, x: Float[Tensor, "m c h w"]) -> Float[Tensor, "m c h w"]:
        pooled = self.global_branch(x).expand(-1, -1, *x.shape[-2:])
        mixed: Tensor = self.mix(torch.cat([*(branch(x) for branch in self.branches), pooled], dim=1))
        return mixed


class DepthNet(nn.Module):
    """Predicts, per cell, a categorical depth and a context vector.

    Args:
        inputs: channels of the incoming feature (image feature and concatenated priors).
        mid_channels: width of the network.
        context_channels: channels lifted into bird's-eye view.
        depth_bins: number of bins.
        camera_vector_channels: length of the camera vector; 0 leaves the gates out.
        residual_blocks: blocks before the dilated context.
        aspp_channels: width of each branch of the dilated context.
        dropout: behind the dilated context.
        deformable: a deformable convolution in four groups before the depth logits (Megvii's).
    """

    def __init__(
        self,
        inputs: int,
        mid_channels: int,
        context_channels: int,
        depth_bins: int,
        camera_vector_channels: int,
        residual_blocks: int,
        aspp_channels: int,
        dropout: float = 0.5,
        deformable: bool = False,
    ) -> None:
        super().__init__()
        self.reduce_conv = conv_bn_relu(inputs, mid_channels, bias=True)
        self.context_conv = nn.Conv2d(mid_channels, context_channels, 1)
        self.depth_conv = nn.Sequential(
            *(BasicBlock(mid_channels, mid_channels) for _ in range(residual_blocks)),
            DilatedContext(mid_channels, aspp_channels, dropout),
            *([DeformableConv(mid_channels, groups=4)] if deformable else []),
            nn.Conv2d(mid_channels, depth_bins, 1),
        )
        self.camera_aware = camera_vector_channels > 0
        if self.camera_aware:
            self.vector_norm = nn.BatchNorm1d(camera_vector_channels)
            self.depth_gate = CameraGate(camera_vector_channels, mid_channels)
            self.context_gate = CameraGate(camera_vector_channels, mid_channels)

    def forward(
        self, x: Float[Tensor, "m c h w"], camera_vector: Float[Tensor, "m k"] | None
    ) -> tuple[Float[Tensor, "m d h w"], Float[Tensor, "m e h w"]]:
        """Depth logits and context features."""
        x = self.reduce_conv(x)
        context = depth = x
        if self.camera_aware:
            vector = self.vector_norm(camera_vector)
            context, depth = self.context_gate(x, vector), self.depth_gate(x, vector)
        return self.depth_conv(depth), self.context_conv(context)
