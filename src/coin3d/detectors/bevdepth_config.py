"""Configurations of BEVDepth: what CoIn3D's authors built on, and Megvii's own (spec official_code 1, detectors 1)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

from coin3d.detectors.center_decode import DecodeOptions
from coin3d.detectors.lift_splat import BevGrid, DepthBins
from coin3d.detectors.task_decode import TaskDecodeOptions
from coin3d.detectors.task_heads import Tasks
from coin3d.detectors.task_losses import TaskLossWeights
from coin3d.priors.released import ReleasedConventions

NUSCENES_TASKS: Tasks = (
    ("car",),
    ("truck", "construction_vehicle"),
    ("bus", "trailer"),
    ("barrier",),
    ("motorcycle", "bicycle"),
    ("pedestrian", "traffic_cone"),
)
"""The ten classes of the nuScenes benchmark by task, in the order of the released head."""


@dataclass(frozen=True)
class MegviiVariant:
    """Where Megvii's BEVDepth is another network than the one that CoIn3D's authors built on.

    Every image level goes into a ``SecondFPN``, a deformable convolution precedes the depth logits, the BEV encoder is a
    ``BevResNet``, and the head has a task for each group of classes. The camera vector is always that of the key frame, and
    where there is no frame before, this one stands in for it.

    Args:
        tasks: classes of each task; the detector's classes are these in order.
        depth_aggregation: refine the lifted features by convolutions over columns and depths.
        feature_stride: of the neck, where depth is estimated.
        weights: of the losses.
        decode: how boxes are read off.
    """

    tasks: Tasks = NUSCENES_TASKS
    depth_aggregation: bool = False
    feature_stride: int = 16
    weights: TaskLossWeights = field(default_factory=TaskLossWeights)
    decode: TaskDecodeOptions = field(default_factory=TaskDecodeOptions)

    def __post_init__(self) -> None:
        if len(self.tasks) != len(self.decode.squared_distance_m2):
            raise ValueError(f"{len(self.tasks)} tasks with {len(self.decode.squared_distance_m2)} distances of suppression")

    @property
    def classes(self) -> tuple[str, ...]:
        """Names of the classes of all tasks, in heat-map order."""
        return tuple(name for task in self.tasks for name in task)


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
        perspective_weight: of the auxiliary loss on the image feature; 0 (as released) builds no head for it.
        decode: how boxes are read off.
        megvii: Megvii's network; depth blocks, widths, bins and grid remain those above.
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
    perspective_weight: float = 0.0
    decode: DecodeOptions = field(default_factory=DecodeOptions)
    megvii: MegviiVariant | None = None
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
        fixed = (self.head_stride, self.grid.slabs, self.previous_by)
        if self.megvii is not None and fixed != (1, 1, "pose"):
            raise ValueError(
                "Megvii's BEVDepth has one slab, a head at the resolution of the grid, and frames placed by pose; "
                f"got head_stride, slabs, previous_by = {fixed}"
            )

    @property
    def feature_stride(self) -> int:
        """Pixels per cell of the neck's feature, where depth is estimated."""
        return self.strides[0] if self.megvii is None else self.megvii.feature_stride

    @property
    def head_grid(self) -> BevGrid:
        """The cells of the heat map."""
        return replace(self.grid, cell_m=self.grid.cell_m * self.head_stride)

    @classmethod
    def paper(cls) -> BEVDepthConfig:
        """ResNet-50 at 704 x 384 with the frame before, the size of the paper's tables."""
        return cls(frames=2, frame_blocks=2)

    @classmethod
    def released_megvii(cls, frames: int = 2, depth_aggregation: bool = False) -> BEVDepthConfig:
        """The network of Megvii's released weights: 704 x 256, ten classes of nuScenes in six tasks.

        Args:
            frames: 2 in all released files; the single frame is known from its code alone.
            depth_aggregation: the files named ``_da``.
        """
        return cls(
            image_height_px=256,
            strides=(4, 8, 16, 32),
            aspp_channels=512,
            frames=frames,
            bins=DepthBins(2.0, 58.0, 0.5),
            megvii=MegviiVariant(
                depth_aggregation=depth_aggregation, weights=TaskLossWeights(velocity=0.5 if frames == 1 else 1.0)
            ),
            released=ReleasedConventions(swapped_images=True),
        )

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
            perspective_weight=1.0,
            decode=DecodeOptions(min_score=0.05),
        )
