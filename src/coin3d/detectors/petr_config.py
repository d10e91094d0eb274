"""Sizes of PETR."""

from __future__ import annotations

from dataclasses import dataclass, field

from coin3d.detectors.object_seeds import check_seeds
from coin3d.detectors.position_embedding_3d import RayPoints
from coin3d.detectors.query_boxes import QueryDecodeOptions
from coin3d.detectors.query_conventions import ReleasedQueryConventions
from coin3d.detectors.query_losses import QueryLossWeights
from coin3d.detectors.space_range import SpaceRange

V2_99 = "v2-99"

_SEEN = SpaceRange((-61.2, -61.2, -10.0), (61.2, 61.2, 10.0))
_OCCUPIED = SpaceRange((-51.2, -51.2, -3.0), (51.2, 51.2, 5.0))


@dataclass(frozen=True)
class PETRConfig:
    """Sizes of the network; the defaults are the paper's (V2-99, 800 wide).

    Args:
        image_width_px: images are resized to this width.
        image_height_px: and the bottom rows kept.
        backbone: ``v2-99`` or a timm ResNet.
        backbone_blocks: residual blocks per stage, if not the named ResNet's own.
        pretrained: start a ResNet from ImageNet weights (needs a download).
        strides: image feature levels, finest first; queries look at the finest.
        neck_channels: channels after the neck.
        channels: of queries and image cells in the decoder.
        normalised_cells: bring all image cells to the same length first. As released they are as long as the trunk makes them:
            what a trunk gives that was not trained for this outweighs the queries fifty times, and all of them see the same.
        queries: learned object queries.
        seeds: further object queries that start from what the image cells show (see object_seeds); 0, as released, for none.
        layers: of the decoder.
        heads: of each attention.
        hidden: width of the feed-forward part of a layer.
        dropout: in the decoder.
        rays: points along the ray of an image cell.
        ray_space: range in which those points are told apart.
        box_space: range in which boxes lie; in the ego frame, or the LiDAR frame of ``released``.
        perspective_weight: of the auxiliary loss on the image feature; 0 (as released) builds no head for it.
        weights: of the losses.
        decode: how boxes are read off.
        released: for converted weights; nothing trained here has it.
    """

    image_width_px: int = 800
    image_height_px: int = 448
    backbone: str = V2_99
    backbone_blocks: tuple[int, ...] = ()
    pretrained: bool = False
    strides: tuple[int, ...] = (16, 32)
    neck_channels: int = 256
    channels: int = 256
    normalised_cells: bool = False
    queries: int = 900
    seeds: int = 0
    layers: int = 6
    heads: int = 8
    hidden: int = 2048
    dropout: float = 0.1
    rays: RayPoints = field(default_factory=RayPoints)
    ray_space: SpaceRange = _SEEN
    box_space: SpaceRange = _OCCUPIED
    perspective_weight: float = 0.0
    weights: QueryLossWeights = field(default_factory=QueryLossWeights)
    decode: QueryDecodeOptions = field(default_factory=QueryDecodeOptions)
    released: ReleasedQueryConventions | None = None

    @property
    def frames(self) -> int:
        """It looks at one frame."""
        return 1

    def __post_init__(self) -> None:
        coarsest = max(self.strides)
        if self.image_width_px % coarsest or self.image_height_px % coarsest:
            raise ValueError(f"the input of {self.image_width_px} x {self.image_height_px} is not a multiple of {coarsest}")
        if self.channels % self.heads:
            raise ValueError(f"{self.channels} channels cannot be shared by {self.heads} attention heads")
        if self.backbone == V2_99 and (self.pretrained or self.backbone_blocks):
            raise ValueError(f"{V2_99} has neither ImageNet weights to download nor other numbers of blocks")
        check_seeds(self.seeds, self.perspective_weight, self.released is not None)

    @classmethod
    def paper(cls) -> PETRConfig:
        """V2-99 at 800 x 448, the size of the paper's tables."""
        return cls()

    @classmethod
    def released_nuscenes(cls) -> PETRConfig:
        """The network of the released weights: 800 x 320, boxes in the LiDAR frame, an embedding of the camera's index."""
        space = SpaceRange((-51.2, -51.2, -5.0), (51.2, 51.2, 3.0))
        return cls(image_height_px=320, box_space=space, released=ReleasedQueryConventions())

    @classmethod
    def small(cls) -> PETRConfig:
        """ResNet-34 at 480 x 192: for one modest GPU."""
        return cls(
            image_width_px=480,
            image_height_px=192,
            backbone="resnet34",
            normalised_cells=True,
            queries=450,
            layers=4,
            hidden=1024,
        )

    @classmethod
    def tiny(cls) -> PETRConfig:
        """Half a ResNet-18 at 352 x 128: trains in minutes on two CPU cores."""
        return cls(
            image_width_px=352,
            image_height_px=128,
            backbone="resnet18",
            backbone_blocks=(1, 1, 1, 1),
            strides=(8, 16),
            neck_channels=96,
            channels=96,
            normalised_cells=True,
            queries=100,
            seeds=80,
            layers=3,
            heads=4,
            hidden=256,
            dropout=0.0,
            rays=RayPoints(count=24),
            perspective_weight=1.0,
            weights=QueryLossWeights(heading=8.0),
            decode=QueryDecodeOptions(max_boxes=100, min_score=0.02),
        )
