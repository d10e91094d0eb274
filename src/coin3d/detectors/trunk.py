"""Pre-training of an image trunk on the recording itself: LiDAR depth and what each image cell shows.

Meant for transformers that would start from random weights: their queries cannot tell which feature to look at before features
mean something. This net has the trunk and two small heads and no lift, queries or attention. One trunk per recording serves
all detectors and methods trained on it, so that the rows of a table start alike.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor, nn

from coin3d.detectors.backbone import ImageBackbone
from coin3d.detectors.batch import Batch
from coin3d.detectors.depth_loss import depth_loss
from coin3d.detectors.detector import Detector
from coin3d.detectors.image_feature import attach_neck, image_feature
from coin3d.detectors.layers import conv_bn_relu
from coin3d.detectors.lift_splat import DepthBins
from coin3d.detectors.method import Method
from coin3d.detectors.perspective import PerspectiveHead, perspective_batch_targets, perspective_loss
from coin3d.geometry import Boxes3D


@runtime_checkable
class HasTrunk(Protocol):
    """Configurations of detectors whose trunk this can train."""

    @property
    def image_width_px(self) -> int: ...
    @property
    def image_height_px(self) -> int: ...
    @property
    def backbone(self) -> str: ...
    @property
    def backbone_blocks(self) -> tuple[int, ...]: ...


@dataclass(frozen=True)
class TrunkConfig:
    """Sizes.

    Args:
        image_width_px: images are resized to this width.
        image_height_px: and the bottom rows kept.
        backbone: a timm ResNet.
        backbone_blocks: residual blocks per stage, if not the named network's own.
        pretrained: start from ImageNet weights (needs a download).
        strides: feature levels that are merged, finest first; the coarsest decides how much of the trunk is trained.
        channels: of the merged feature and the heads.
        bins: of the apparent depth, see ``TrunkPretraining``.
    """

    image_width_px: int = 704
    image_height_px: int = 384
    backbone: str = "resnet50"
    backbone_blocks: tuple[int, ...] = ()
    pretrained: bool = False
    strides: tuple[int, ...] = (8, 16, 32)
    channels: int = 128
    bins: DepthBins = field(default_factory=lambda: DepthBins(1.0, 81.0, 1.0))

    @property
    def frames(self) -> int:
        """It looks at one frame."""
        return 1

    @classmethod
    def of(cls, detector: HasTrunk) -> TrunkConfig:
        """For the trunk of a detector.

        Raises:
            ValueError: a trunk that is no timm ResNet.
        """
        if not detector.backbone.startswith("resnet"):
            raise ValueError(f"trunks that can be trained beforehand are ResNets, this detector has {detector.backbone}")
        tiny = bool(detector.backbone_blocks)
        return cls(
            detector.image_width_px,
            detector.image_height_px,
            detector.backbone,
            detector.backbone_blocks,
            strides=(8, 16) if tiny else (8, 16, 32),
            channels=64 if tiny else 128,
        )


class TrunkPretraining(Detector):
    """Trunk and neck with two heads: the depth of each cell, and ``PerspectiveTargets``.

    Depth is that of a camera with the reference lens (width / focal length = 1): the same road through a longer lens looks
    nearer, and nothing in one image tells the lens from the distance. The camera's own depth follows by its focal length.

    Args:
        config: sizes.
        classes: of the boxes; all are treated alike.
        method: ``none``; a method's maps are not looked at here.
    """

    name = "trunk"
    config: TrunkConfig

    def __init__(self, config: TrunkConfig, classes: tuple[str, ...], method: Method) -> None:
        super().__init__()
        self.config, self.classes, self.method = config, classes, method
        self.backbone = ImageBackbone(
            config.backbone, config.strides, method.extra_image_channels, config.pretrained, config.backbone_blocks
        )
        self.neck, channels = attach_neck(method, self.backbone, config.strides, config.channels)
        self.depth = nn.Sequential(conv_bn_relu(channels, config.channels), nn.Conv2d(config.channels, config.bins.count, 1))
        self.perspective = PerspectiveHead(channels, config.channels)

    def losses(self, batch: Batch) -> dict[str, Float[Tensor, ""]]:
        """``depth`` and ``perspective``."""
        if batch.depth_m is None or len(batch.boxes) != batch.num_samples:
            raise ValueError("a trunk learns from LiDAR depth and boxes: this batch lacks one of them")
        feature, _ = image_feature(self.method, self.backbone, self.neck, self.config.strides, batch)
        depth_logits, shown = self.depth(feature), self.perspective(feature)
        apparent_m = batch.depth_m * (batch.cameras.width_px / batch.cameras.focal_px)[:, None, None]
        stride = self.config.strides[0]
        with torch.autocast(batch.images.device.type, enabled=False):
            return {
                "depth": depth_loss(depth_logits, apparent_m, self.config.bins, stride),
                "perspective": perspective_loss(shown, perspective_batch_targets(batch, stride)),
            }

    def detect(self, batch: Batch) -> list[Boxes3D]:
        """It detects nothing.

        Raises:
            ValueError: always.
        """
        raise ValueError("this is a pre-trained trunk: start a detector from it with coin3d train --trunk")
