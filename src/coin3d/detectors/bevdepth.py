"""BEVDepth: image trunk -> neck -> depth net -> lift-splat -> BEV encoder -> CenterPoint head.

Layer by layer as spec official_code 1.2-1.6, or, where the configuration has its ``megvii``, as spec detectors 1. The method of
transfer enters through the hooks of ``Method`` only.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from coin3d.detectors.backbone import ImageBackbone
from coin3d.detectors.batch import Batch
from coin3d.detectors.bev_encoder import BevEncoder, residual_stage
from coin3d.detectors.bev_resnet import BevResNet
from coin3d.detectors.bev_warp import warp_bev
from coin3d.detectors.bevdepth_config import BEVDepthConfig
from coin3d.detectors.center_decode import decode_centers
from coin3d.detectors.center_head import CenterHead
from coin3d.detectors.center_targets import center_losses, center_targets
from coin3d.detectors.depth_aggregation import DepthAggregation
from coin3d.detectors.depth_loss import depth_loss
from coin3d.detectors.depth_net import DepthNet
from coin3d.detectors.detector import Detector
from coin3d.detectors.image_feature import attach_levels, attach_neck, image_feature
from coin3d.detectors.lift_splat import LiftSplat
from coin3d.detectors.method import Method
from coin3d.detectors.neck import FeaturePyramid
from coin3d.detectors.perspective import PerspectiveHead, perspective_batch_targets, perspective_loss
from coin3d.detectors.released_image import swapped
from coin3d.detectors.released_lift import ReleasedLiftSplat
from coin3d.detectors.second_fpn import SecondFPN
from coin3d.detectors.task_decode import decode_tasks
from coin3d.detectors.task_heads import TaskHeads
from coin3d.detectors.task_losses import task_losses
from coin3d.geometry import Boxes3D
from coin3d.geometry.camera_tensors import CameraTensors


class BEVDepth(Detector):
    """The detector.

    Args:
        config: sizes.
        classes: names of the classes, in heat-map order.
        method: the method of transfer; it is attached to this detector and becomes part of its weights.

    Raises:
        ValueError: classes that are not those of the tasks of Megvii's head.
    """

    name = "bevdepth"
    config: BEVDepthConfig

    def __init__(self, config: BEVDepthConfig, classes: tuple[str, ...], method: Method) -> None:
        super().__init__()
        self.config, self.classes, self.method = config, classes, method
        megvii = config.megvii
        if megvii is not None and classes != megvii.classes:
            raise ValueError(f"the classes of this head's tasks are {', '.join(megvii.classes)}; got {', '.join(classes)}")
        self.backbone = ImageBackbone(
            config.backbone, config.strides, method.extra_image_channels, config.pretrained, config.backbone_blocks
        )
        self.neck: FeaturePyramid | SecondFPN
        if megvii is None:
            self.neck, modulated_channels = attach_neck(method, self.backbone, config.strides, config.neck_channels)
        else:
            levels = attach_levels(method, self.backbone, config.strides)
            self.neck = SecondFPN(levels, config.strides, config.feature_stride, config.neck_channels)
            modulated_channels = method.attach("neck", config.neck_channels, config.feature_stride)
        self.depth_net = DepthNet(
            modulated_channels,
            config.depth_channels,
            config.context_channels,
            config.bins.count,
            method.camera_vector_channels,
            config.depth_blocks,
            config.aspp_channels,
            config.depth_dropout,
            deformable=megvii is not None,
        )
        self.aggregation = DepthAggregation(config.context_channels) if megvii and megvii.depth_aggregation else None
        lift = LiftSplat if config.released is None else ReleasedLiftSplat
        self.lift_splat = lift(config.grid, config.bins, config.feature_stride)
        bev_inputs = config.context_channels * config.grid.slabs
        self.frame_encoder = residual_stage(bev_inputs, bev_inputs, 1, config.frame_blocks) if config.frame_blocks else None
        stages, outputs = config.bev_stages, config.bev_channels
        self.bev_encoder: BevEncoder | BevResNet
        self.head: CenterHead | TaskHeads
        if megvii is None:
            self.bev_encoder = BevEncoder(bev_inputs * config.frames, stages, outputs, config.head_stride)
            self.head = CenterHead(outputs, len(classes), config.head_channels)
        else:
            self.bev_encoder = BevResNet(bev_inputs * config.frames, stages, outputs)
            self.head = TaskHeads(outputs, megvii.tasks, config.head_channels)
        self.perspective = PerspectiveHead(modulated_channels, config.neck_channels) if config.perspective_weight else None

    def forward(self, batch: Batch) -> dict[str, Tensor]:
        """Head outputs, ``depth_logits`` (M, D, h, w) and, in training where it is supervised, ``perspective`` (M, 6, h, w)."""
        bev, depth_logits, feature = self.lift(batch, batch.lift_cameras, batch.cameras)
        if self.config.frames == 2:
            bev = torch.cat([bev, self.previous_bev(batch, bev)], dim=1)
        outputs: dict[str, Tensor] = self.head(self.bev_encoder(bev))
        if self.perspective is not None and self.training:
            outputs["perspective"] = self.perspective(feature)
        return {**outputs, "depth_logits": depth_logits}

    def lift(self, batch: Batch, lift_cameras: CameraTensors, gates: CameraTensors) -> tuple[Tensor, Tensor, Tensor]:
        """One frame in bird's-eye view (B, C, Y, X), its depth logits, and the modulated image feature.

        Args:
            batch: images, and cameras as the method sees them.
            lift_cameras: where the features are lifted from.
            gates: cameras whose numbers gate the depth net.
        """
        if self.config.released is not None and self.config.released.swapped_images:
            batch = replace(batch, images=swapped(batch.images))
        feature, context = image_feature(self.method, self.backbone, self.neck, self.config.strides, batch)
        vector = self.method.camera_vector(gates, batch.bev_from_ego[batch.sample_index], context)
        depth_logits, lifted = self.depth_net(feature, vector)
        depth_logits = depth_logits.float()  # a softmax over many bins collapses in half precision
        depth = depth_logits.softmax(dim=1)
        where = lift_cameras, batch.sample_index, batch.bev_from_ego, not self.training
        if self.aggregation is None:
            bev = self.lift_splat(depth, lifted, *where)
        else:
            bev = self.lift_splat.pool(self.aggregation(depth, lifted), *where)
        return (bev if self.frame_encoder is None else self.frame_encoder(bev)), depth_logits, feature

    @torch.no_grad()
    def previous_bev(self, batch: Batch, like: Float[Tensor, "b c y x"]) -> Float[Tensor, "b c y x"]:
        """The frame before, in the BEV of this one; without it zeros (spec official_code 1.4), or Megvii's this one."""
        before, megvii = batch.previous, self.config.megvii
        if before is None:
            return torch.zeros_like(like) if megvii is None else like.detach()
        if self.config.previous_by == "pose" and megvii is None:
            return self.lift(before, before.lift_cameras, before.cameras)[0]
        if not torch.equal(before.sample_index, batch.sample_index):
            raise ValueError("this BEVDepth (megvii, or previous_by='warp') needs the same cameras in both frames")
        if megvii is not None:
            return self.lift(before, before.lift_cameras, batch.cameras)[0]
        now = batch.lift_cameras.ego_from_cam
        bev = self.lift(before, replace(before.cameras, ego_from_cam=now), before.cameras)[0]
        first = torch.searchsorted(batch.sample_index, torch.arange(batch.num_samples, device=now.device))
        bev_from_ego = torch.eye(4, dtype=torch.float64, device=now.device).repeat(batch.num_samples, 1, 1)
        bev_from_ego[:, :3, :3] = batch.bev_from_ego
        seen_from_true = now[first].double() @ torch.linalg.inv(before.lift_cameras.ego_from_cam[first].double())
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
        targets = center_targets(
            batch.boxes,
            self.classes,
            config.head_grid,
            min_radius_cells=config.min_radius_cells,
            single_precision=config.released is not None,
        )
        with torch.autocast(device.type, enabled=False):  # CUDA refuses this cross-entropy in half precision
            if config.megvii is None:
                losses = center_losses(outputs, targets.to(device))
            else:
                losses = task_losses(outputs, targets.to(device), config.megvii.tasks, config.megvii.weights)
            losses["depth"] = depth_loss(depth_logits, batch.depth_m, config.bins, config.feature_stride)
            if perspective is not None:
                cells = perspective_batch_targets(batch, config.feature_stride)
                losses["perspective"] = config.perspective_weight * perspective_loss(perspective, cells)
        return losses

    @torch.no_grad()
    def detect(self, batch: Batch) -> list[Boxes3D]:
        """Boxes of each sample in the ego frame (the batch carries no BEV augmentation), best first."""
        outputs = self(batch)
        config = self.config
        if config.megvii is not None:
            return decode_tasks(outputs, config.megvii.tasks, config.grid, config.megvii.decode)
        return decode_centers(outputs, self.classes, config.head_grid, config.decode)
