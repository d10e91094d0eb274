"""BEVDepth: image trunk -> neck -> depth net -> lift-splat -> BEV encoder -> CenterPoint head.

Layer by layer as spec official_code 1.2-1.6. The method of transfer enters through the hooks of ``Method`` only.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from coin3d.detectors.backbone import ImageBackbone
from coin3d.detectors.batch import Batch
from coin3d.detectors.bev_encoder import BevEncoder, residual_stage
from coin3d.detectors.bev_warp import warp_bev
from coin3d.detectors.center_decode import DecodeOptions, decode_centers
from coin3d.detectors.center_head import CenterHead
from coin3d.detectors.center_targets import center_losses, center_targets
from coin3d.detectors.depth_loss import depth_loss
from coin3d.detectors.depth_net import DepthNet
from coin3d.detectors.detector import Detector
from coin3d.detectors.image_feature import attach_neck, image_feature
from coin3d.detectors.lift_splat import BevGrid, DepthBins, LiftSplat
from coin3d.detectors.method import Method
from coin3d.detectors.perspective import PerspectiveHead, perspective_batch_targets, perspective_loss
from coin3d.detectors.released_lift import ReleasedLiftSplat
from coin3d.geometry import Boxes3D
from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.priors.released import ReleasedConventions


@dataclass(frozen=True)
class BEVDepthConfig:
    """Sizes of the network; the defaults are the paper's (R50, 704 wide, spec official_code 1).

    Args:
        image_width_px: images are resized to this width.
        image_height_px: and the bottom rows kept.
        backbone: a timm ResNet.
        backbone_blocks: residual blocks per stage, if not the named network's own.
        pretrained: start the backbone from ImageNet weights (needs a download).
        strides: image feature levels, finest first; depth is estimated at the finest.
        neck_channels: channels after the neck.
        depth_channels: width of the depth net.
        depth_blocks: residual blocks of the depth net.
        aspp_channels: width of each dilated branch.
        depth_dropout: dropout behind them.
        context_channels: channels lifted to BEV (into each height slab of the grid).
        frames: 2 looks at the frame before as well (without gradients).
        frame_blocks: residual blocks on each frame's BEV before the frames are put together.
        previous_by: how the frame before gets to the place of this one: ``pose`` lifts it from where its cameras were;
            ``warp`` lifts it as if they were where they are now and moves the BEV, as the released code does in tests.
        bins: depth bins.
        grid: bird's-eye-view grid.
        bev_stages: channels of the BEV encoder.
        bev_channels: channels the head reads.
        head_stride: cells of the grid per cell of the head, 1 or 2.
        head_channels: width of the head.
        min_radius_cells: smallest heat-map peak.
        heading_share: factor on the weight of the heading within the box losses, 1 as released.
        perspective_weight: of the auxiliary loss on the image feature; 0 (as released) builds no head for it.
        decode: how boxes are read off.
        released: geometry of the released code, for its weights only.
    """

    image_width_px: int = 704
    image_height_px: int = 384
    backbone: str = "resnet50"
    backbone_blocks: tuple[int, ...] = ()
    pretrained: bool = False
    strides: tuple[int, ...] = (16, 32)
    neck_channels: int = 512
    depth_channels: int = 512
    depth_blocks: int = 3
    aspp_channels: int = 96
    depth_dropout: float = 0.5
    context_channels: int = 80
    frames: int = 1
    frame_blocks: int = 0
    previous_by: Literal["pose", "warp"] = "pose"
    bins: DepthBins = field(default_factory=DepthBins)
    grid: BevGrid = field(default_factory=BevGrid)
    bev_stages: tuple[int, ...] = (160, 320, 640)
    bev_channels: int = 256
    head_stride: int = 1
    head_channels: int = 64
    min_radius_cells: int = 2
    heading_share: float = 1.0
    perspective_weight: float = 0.0
    decode: DecodeOptions = field(default_factory=DecodeOptions)
    released: ReleasedConventions | None = None

    def __post_init__(self) -> None:
        coarsest = max(self.strides)
        if self.image_width_px % coarsest or self.image_height_px % coarsest:
            raise ValueError(f"the input of {self.image_width_px} x {self.image_height_px} is not a multiple of {coarsest}")
        if self.grid.side % 8:
            raise ValueError(f"the BEV grid has {self.grid.side} cells a side; the encoder needs a multiple of 8")
        if self.frames not in (1, 2):
            raise ValueError(f"frames is 1 or 2, got {self.frames}")
        if self.head_stride not in (1, 2):
            raise ValueError(f"head_stride is 1 or 2, got {self.head_stride}")

    @property
    def head_grid(self) -> BevGrid:
        """The cells of the heat map."""
        return replace(self.grid, cell_m=self.grid.cell_m * self.head_stride)

    @classmethod
    def paper(cls) -> BEVDepthConfig:
        """ResNet-50 at 704 x 384, the size of the paper's tables."""
        return cls()

    @classmethod
    def small(cls) -> BEVDepthConfig:
        """ResNet-34 at 480 x 192: for one modest GPU."""
        return cls(
            image_width_px=480,
            image_height_px=192,
            backbone="resnet34",
            neck_channels=256,
            depth_channels=256,
            aspp_channels=64,
            context_channels=64,
            bev_stages=(96, 192, 384),
            bev_channels=128,
        )

    @classmethod
    def tiny(cls) -> BEVDepthConfig:
        """Half a ResNet-18 at 352 x 128: trains in minutes on two CPU cores."""
        return cls(
            image_width_px=352,
            image_height_px=128,
            backbone="resnet18",
            backbone_blocks=(1, 1, 1, 1),
            strides=(8, 16),
            neck_channels=64,
            depth_channels=64,
            depth_blocks=1,
            aspp_channels=32,
            depth_dropout=0.0,
            context_channels=16,
            bins=DepthBins(1.0, 60.0, 1.0),
            grid=BevGrid(z_edges_m=(-5.0, 0.3, 1.0, 1.8, 3.0)),
            bev_stages=(32, 64, 128),
            bev_channels=32,
            head_stride=2,
            head_channels=32,
            min_radius_cells=1,
            heading_share=2.0,
            perspective_weight=1.0,
            decode=DecodeOptions(min_score=0.05),
        )


class BEVDepth(Detector):
    """The detector.

    Args:
        config: sizes.
        classes: names of the classes, in heat-map order.
        method: the method of transfer; it is attached to this detector and becomes part of its weights.
    """

    name = "bevdepth"
    config: BEVDepthConfig

    def __init__(self, config: BEVDepthConfig, classes: tuple[str, ...], method: Method) -> None:
        super().__init__()
        self.config, self.classes, self.method = config, classes, method
        self.backbone = ImageBackbone(
            config.backbone, config.strides, method.extra_image_channels, config.pretrained, config.backbone_blocks
        )
        self.neck, modulated_channels = attach_neck(method, self.backbone, config.strides, config.neck_channels)
        self.depth_net = DepthNet(
            modulated_channels,
            config.depth_channels,
            config.context_channels,
            config.bins.count,
            method.camera_vector_channels,
            config.depth_blocks,
            config.aspp_channels,
            config.depth_dropout,
        )
        lift = LiftSplat if config.released is None else ReleasedLiftSplat
        self.lift_splat = lift(config.grid, config.bins, config.strides[0])
        bev_inputs = config.context_channels * config.grid.slabs
        self.frame_encoder = residual_stage(bev_inputs, bev_inputs, 1, config.frame_blocks) if config.frame_blocks else None
        self.bev_encoder = BevEncoder(bev_inputs * config.frames, config.bev_stages, config.bev_channels, config.head_stride)
        self.head = CenterHead(config.bev_channels, len(classes), config.head_channels)
        self.perspective = PerspectiveHead(modulated_channels, config.neck_channels) if config.perspective_weight else None

    def forward(self, batch: Batch) -> dict[str, Tensor]:
        """Head outputs, ``depth_logits`` (M, D, h, w) and, in training where it is supervised, ``perspective`` (M, 6, h, w)."""
        bev, depth_logits, feature = self.lift(batch, batch.lift_cameras)
        if self.config.frames == 2:
            bev = torch.cat([bev, self.previous_bev(batch, bev)], dim=1)
        outputs: dict[str, Tensor] = self.head(self.bev_encoder(bev))
        if self.perspective is not None and self.training:
            outputs["perspective"] = self.perspective(feature)
        return {**outputs, "depth_logits": depth_logits}

    def lift(self, batch: Batch, lift_cameras: CameraTensors) -> tuple[Tensor, Tensor, Tensor]:
        """One frame in bird's-eye view (B, C, Y, X), its depth logits, and the modulated image feature.

        Args:
            batch: images, and cameras as the method sees them.
            lift_cameras: where the features are lifted from.
        """
        feature, context = image_feature(self.method, self.backbone, self.neck, self.config.strides, batch)
        vector = self.method.camera_vector(batch.cameras, batch.bev_from_ego[batch.sample_index], context)
        depth_logits, lifted = self.depth_net(feature, vector)
        depth_logits = depth_logits.float()  # a softmax over many bins collapses in half precision
        depth = depth_logits.softmax(dim=1)
        bev = self.lift_splat(depth, lifted, lift_cameras, batch.sample_index, batch.bev_from_ego, reuse=not self.training)
        return (bev if self.frame_encoder is None else self.frame_encoder(bev)), depth_logits, feature

    @torch.no_grad()
    def previous_bev(self, batch: Batch, like: Float[Tensor, "b c y x"]) -> Float[Tensor, "b c y x"]:
        """The frame before, in the BEV of this one; zeros without it (spec official_code 1.4)."""
        before = batch.previous
        if before is None:
            return torch.zeros_like(like)
        if self.config.previous_by == "pose":
            return self.lift(before, before.lift_cameras)[0]
        if not torch.equal(before.sample_index, batch.sample_index):
            raise ValueError("previous_by='warp' needs the same cameras in both frames; use 'pose'")
        now = batch.lift_cameras.ego_from_cam
        bev = self.lift(before, replace(before.cameras, ego_from_cam=now))[0]
        first = torch.searchsorted(batch.sample_index, torch.arange(batch.num_samples, device=now.device))
        bev_from_ego = torch.eye(4, device=now.device).repeat(batch.num_samples, 1, 1)
        bev_from_ego[:, :3, :3] = batch.bev_from_ego
        seen_from_true = now[first] @ torch.linalg.inv(before.lift_cameras.ego_from_cam[first])
        moved = bev_from_ego @ seen_from_true @ torch.linalg.inv(bev_from_ego)
        return warp_bev(bev, moved, self.config.grid, 0.5 if self.config.released is None else 0.0)

    def losses(self, batch: Batch) -> dict[str, Float[Tensor, ""]]:
        """Weighted losses by name; their sum is what is minimised."""
        if batch.depth_m is None:
            raise ValueError("training needs LiDAR depth: this batch has none (was the recording made without LiDAR?)")
        if len(batch.boxes) != batch.num_samples:
            raise ValueError(f"training needs boxes: {len(batch.boxes)} tables of them for {batch.num_samples} samples")
        if len(batch.images) < 2:
            raise ValueError("training needs two images or more per step, for batch norm; take more cameras or samples")
        config, device = self.config, batch.images.device
        outputs = self(batch)
        depth_logits, perspective = outputs.pop("depth_logits"), outputs.pop("perspective", None)
        targets = center_targets(batch.boxes, self.classes, config.head_grid, min_radius_cells=config.min_radius_cells)
        with torch.autocast(device.type, enabled=False):  # CUDA refuses this cross-entropy in half precision
            losses = center_losses(outputs, targets.to(device), heading_share=config.heading_share)
            losses["depth"] = depth_loss(depth_logits, batch.depth_m, config.bins, config.strides[0])
            if perspective is not None:
                cells = perspective_batch_targets(batch, config.strides[0])
                losses["perspective"] = config.perspective_weight * perspective_loss(perspective, cells)
        return losses

    @torch.no_grad()
    def detect(self, batch: Batch) -> list[Boxes3D]:
        """Boxes of each sample in the ego frame (the batch carries no BEV augmentation), best first."""
        outputs = self(batch)
        return decode_centers(outputs, self.classes, self.config.head_grid, self.config.decode)
