"""Sizes of BEVFormer."""

from __future__ import annotations

from dataclasses import dataclass, field

from coin3d.detectors.lift_splat import BevGrid
from coin3d.detectors.object_seeds import check_seeds
from coin3d.detectors.query_boxes import QueryDecodeOptions
from coin3d.detectors.query_losses import QueryLossWeights
from coin3d.detectors.released_bevformer import ReleasedBevFormer
from coin3d.detectors.space_range import SpaceRange


@dataclass(frozen=True)
class BEVFormerConfig:
    """Sizes of the network; the defaults are those of BEVFormer-tiny, which the paper uses (spec detectors 2).

    Args:
        image_width_px: images are resized to this width.
        image_height_px: and the bottom rows kept.
        backbone: a timm ResNet.
        backbone_blocks: residual blocks per stage, if not the named network's own.
        pretrained: start the backbone from ImageNet weights (needs a download).
        strides: image feature levels, finest first; the queries look at the finest, after the neck.
        channels: width of neck, queries and bird's-eye view.
        heads: attention heads.
        frames: 2 or more look at the frames before as well (without gradients).
        grid: bird's-eye-view grid; its extent and heights are also the range of the boxes.
        anchor_heights_m: points of the pillar over a cell that are looked for in the images.
        encoder_layers: layers of bird's-eye-view queries.
        temporal_points: looks per head into the previous and the present bird's-eye view.
        spatial_points: looks per head into an image, shared out over the anchors.
        looks_at_anchors: start with looks close to the anchors, each head at one of its own, as few steps ask for; the
            released start looks up to ``spatial_points`` cells around them. Needs as many points as anchors.
        decoder_layers: layers of object queries.
        queries: learned object queries.
        seeds: further object queries that start from the boxes of a dense head on the bird's-eye view (see object_seeds); 0, as
            released, for none.
        decoder_points: looks per head of an object query.
        hidden: width inside the feed-forward networks.
        dropout: in all transformer layers.
        perspective_weight: of the auxiliary loss on the image feature; 0 (as released) builds no head for it.
        weights: of the losses.
        decode: how boxes are read off.
        released: conventions of the released weights; None for models trained here.
    """

    image_width_px: int = 800
    image_height_px: int = 448
    backbone: str = "resnet50"
    backbone_blocks: tuple[int, ...] = ()
    pretrained: bool = False
    strides: tuple[int, ...] = (32,)
    channels: int = 256
    heads: int = 8
    frames: int = 1
    grid: BevGrid = field(default_factory=lambda: BevGrid(51.2, 2.048, (-3.0, 5.0)))
    anchor_heights_m: tuple[float, ...] = (-0.5, 0.5, 1.5, 2.5)
    encoder_layers: int = 3
    temporal_points: int = 4
    spatial_points: int = 8
    looks_at_anchors: bool = False
    decoder_layers: int = 6
    queries: int = 900
    seeds: int = 0
    decoder_points: int = 4
    hidden: int = 512
    dropout: float = 0.1
    perspective_weight: float = 0.0
    weights: QueryLossWeights = field(default_factory=QueryLossWeights)
    decode: QueryDecodeOptions = field(default_factory=QueryDecodeOptions)
    released: ReleasedBevFormer | None = None

    def __post_init__(self) -> None:
        coarsest = max(self.strides)
        if self.image_width_px % coarsest or self.image_height_px % coarsest:
            raise ValueError(f"the input of {self.image_width_px} x {self.image_height_px} is not a multiple of {coarsest}")
        if self.frames < 1:
            raise ValueError(f"frames is at least 1, got {self.frames}")
        if self.channels % (2 * self.heads):
            raise ValueError(f"{self.channels} channels do not share out over {self.heads} heads and two axes")
        if not self.anchor_heights_m or self.spatial_points % len(self.anchor_heights_m):
            raise ValueError(f"{self.spatial_points} points do not share out over {len(self.anchor_heights_m)} anchor heights")
        if self.looks_at_anchors and self.spatial_points != len(self.anchor_heights_m):
            raise ValueError(f"looks_at_anchors needs as many points as anchors, got {self.spatial_points} points")
        check_seeds(self.seeds, 1.0, self.released is not None)

    @property
    def box_space(self) -> SpaceRange:
        """Range of space in which boxes lie; in the ego frame, or the LiDAR frame of ``released``."""
        reach, heights = self.grid.half_extent_m, self.grid.z_edges_m
        return SpaceRange((-reach, -reach, heights[0]), (reach, reach, heights[-1]))

    @classmethod
    def paper(cls) -> BEVFormerConfig:
        """ResNet-50 at 800 x 448 with two frames before, the size of the paper's tables."""
        return cls(frames=3)

    @classmethod
    def small(cls) -> BEVFormerConfig:
        """ResNet-34 at 480 x 192: for one modest GPU."""
        return cls(
            image_width_px=480,
            image_height_px=192,
            backbone="resnet34",
            strides=(16, 32),
            channels=192,
            decoder_layers=4,
            queries=400,
            hidden=384,
        )

    @classmethod
    def tiny(cls) -> BEVFormerConfig:
        """Half a ResNet-18 at 352 x 128: trains on two CPU cores."""
        return cls(
            image_width_px=352,
            image_height_px=128,
            backbone="resnet18",
            backbone_blocks=(1, 1, 1, 1),
            strides=(8, 16),
            channels=96,
            heads=8,
            grid=BevGrid(51.2, 1.6, (-3.0, 5.0)),
            anchor_heights_m=(0.1, 0.7, 1.3, 1.9),
            spatial_points=4,
            looks_at_anchors=True,
            encoder_layers=1,
            decoder_layers=3,
            queries=100,
            seeds=80,
            hidden=192,
            dropout=0.0,
            perspective_weight=1.0,
            weights=QueryLossWeights(heading=8.0),
            decode=QueryDecodeOptions(max_boxes=100, min_score=0.02),
        )

    @classmethod
    def released_nuscenes(cls) -> BEVFormerConfig:
        """What the released BEVFormer-tiny weights are loaded into."""
        return cls(
            image_height_px=480,
            grid=BevGrid(51.2, 2.048, (-5.0, 3.0)),
            anchor_heights_m=(-4.5, -6.5 / 3, 0.5 / 3, 2.5),
            released=ReleasedBevFormer(),
        )
