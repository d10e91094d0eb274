"""BEVFormer: image trunk -> neck -> bird's-eye-view queries that look into the images -> object queries that look into those.

The top-down paradigm, layer by layer as spec detectors 2. Boxes and bird's-eye view are in the ego frame; history is optional
and enters through ego poses only. The method of transfer enters through the hooks of ``Method`` only.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from coin3d.detectors.backbone import ImageBackbone
from coin3d.detectors.batch import Batch
from coin3d.detectors.bevformer_encoder import BevFormerEncoder, BevHistory, LearnedPosition
from coin3d.detectors.deformable_attention import SamplingPlan
from coin3d.detectors.lift_splat import BevGrid
from coin3d.detectors.method import Method
from coin3d.detectors.neck import FeaturePyramid
from coin3d.detectors.pillar_projection import cell_centres, image_from_bev, pillar_anchors, project_pillars
from coin3d.detectors.query_decoder import QueryDecoder
from coin3d.detectors.released_bevformer import ReleasedBevFormer, ReleasedParts
from coin3d.detectors.spatial_cross_attention import VisibleQueries


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
        grid: bird's-eye-view grid; its extent and heights are also the range of the boxes.
        anchor_heights_m: points of the pillar over a cell that are looked for in the images.
        encoder_layers: layers of bird's-eye-view queries.
        temporal_points: looks per head into the previous and the present bird's-eye view.
        spatial_points: looks per head into an image, shared out over the anchors.
        decoder_layers: layers of object queries.
        queries: object queries.
        decoder_points: looks per head of an object query.
        hidden: width inside the feed-forward networks.
        dropout: in all transformer layers.
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
    grid: BevGrid = field(default_factory=lambda: BevGrid(51.2, 2.048, (-3.0, 5.0)))
    anchor_heights_m: tuple[float, ...] = (-0.5, 0.5, 1.5, 2.5)
    encoder_layers: int = 3
    temporal_points: int = 4
    spatial_points: int = 8
    decoder_layers: int = 6
    queries: int = 900
    decoder_points: int = 4
    hidden: int = 512
    dropout: float = 0.1
    released: ReleasedBevFormer | None = None

    def __post_init__(self) -> None:
        coarsest = max(self.strides)
        if self.image_width_px % coarsest or self.image_height_px % coarsest:
            raise ValueError(f"the input of {self.image_width_px} x {self.image_height_px} is not a multiple of {coarsest}")
        if self.channels % (2 * self.heads):
            raise ValueError(f"{self.channels} channels do not share out over {self.heads} heads and two axes")
        if not self.anchor_heights_m or self.spatial_points % len(self.anchor_heights_m):
            raise ValueError(f"{self.spatial_points} points do not share out over {len(self.anchor_heights_m)} anchor heights")

    @classmethod
    def paper(cls) -> BEVFormerConfig:
        """ResNet-50 at 800 x 448, the size of the paper's tables."""
        return cls()

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
            heads=6,
            grid=BevGrid(51.2, 2.56, (-3.0, 5.0)),
            encoder_layers=2,
            decoder_layers=3,
            queries=150,
            hidden=192,
            dropout=0.0,
        )

    @classmethod
    def released_nuscenes(cls) -> BEVFormerConfig:
        """What the released BEVFormer-tiny weights are loaded into."""
        return cls(
            image_height_px=480,
            grid=BevGrid(51.2, 2.048, (-5.0, 3.0)),
            anchor_heights_m=tuple(torch.linspace(-4.5, 2.5, 4).tolist()),
            released=ReleasedBevFormer(),
        )


class BEVFormer(nn.Module):
    """The detector.

    Args:
        config: sizes.
        classes: names of the classes, in the order of the logits.
        method: the method of transfer; it is attached to this detector and becomes part of its weights.
    """

    name = "bevformer"

    def __init__(self, config: BEVFormerConfig, classes: tuple[str, ...], method: Method) -> None:
        super().__init__()
        self.config, self.classes, self.method = config, classes, method
        self.backbone = ImageBackbone(
            config.backbone, config.strides, method.extra_image_channels, config.pretrained, config.backbone_blocks
        )
        attached = [
            method.attach(f"backbone_{stride}", channels, stride)
            for stride, channels in zip(config.strides, self.backbone.channels, strict=True)
        ]
        self.neck = FeaturePyramid(attached, config.channels)
        modulated_channels = method.attach("neck", config.channels, config.strides[0])
        self.narrow = (
            nn.Identity() if modulated_channels == config.channels else nn.Conv2d(modulated_channels, config.channels, 1)
        )
        self.bev_queries = nn.Parameter(torch.randn(config.grid.side**2, config.channels))
        self.bev_position = LearnedPosition(config.grid.side, config.channels)
        self.encoder = BevFormerEncoder(
            config.encoder_layers,
            config.channels,
            config.heads,
            config.temporal_points,
            config.spatial_points,
            config.hidden,
            config.dropout,
        )
        self.decoder = QueryDecoder(
            config.decoder_layers,
            config.queries,
            len(classes),
            config.channels,
            config.heads,
            config.decoder_points,
            config.hidden,
            config.dropout,
        )
        self.released = ReleasedParts(config.released, config.grid, config.channels) if config.released else None
        _initialise(self.encoder)
        _initialise(self.decoder)

    def forward(
        self,
        batch: Batch,
        previous_bev: Float[Tensor, "b q c"] | None = None,
        previous_from_current: Float[Tensor, "b 4 4"] | None = None,
        bus: Float[Tensor, "b 18"] | None = None,
    ) -> dict[str, Tensor]:
        """Of L decoder layers and N queries ``class_logits`` (L, B, N, K) and ``boxes`` (L, B, N, 10); ``bev`` (B, Q, C).

        Boxes are (x, y, log length, log width, z of the centre, log height, sin yaw, cos yaw, vx, vy) in the BEV frame.

        Args:
            batch: the present frames.
            previous_bev: ``bev`` of the frames before, made with the same BEV augmentation; None for single frames.
            previous_from_current: poses of the present ego frames in the previous ones; needed with ``previous_bev``.
            bus: for released weights only, the vehicle's own numbers (see ``ReleasedBevFormer``) instead of what the
                poses tell.

        Raises:
            ValueError: history without motion, or bus numbers for a model that knows none.
        """
        if previous_bev is not None and previous_from_current is None and bus is None:
            raise ValueError("previous_bev needs previous_from_current: how the ego vehicle moved since")
        if bus is not None and self.released is None:
            raise ValueError("only released weights read the vehicle's bus; give previous_from_current alone")
        features, bev_from_ego = self._features(batch), self._bev_from_ego(batch)
        centres = cell_centres(self.config.grid, features.device)
        samples = batch.num_samples
        history = None
        if self.released is None:
            queries = self.bev_queries.expand(samples, -1, -1)
            if previous_bev is not None and previous_from_current is not None:
                moved = bev_from_ego @ previous_from_current.double() @ torch.linalg.inv(bev_from_ego)
                history = align_history(previous_bev, moved, self.config.grid)
        else:
            if bus is None:
                still = torch.eye(4, device=features.device).expand(samples, 4, 4)
                bus = self.released.bus_from_motion(still if previous_from_current is None else previous_from_current)
            features = self.released.features(features, batch.sample_index)
            queries = self.released.queries(self.bev_queries, bus)
            if previous_bev is not None:
                history = self.released.history(previous_bev, bus, centres)
        visible = self._visible(batch, bev_from_ego)
        bev = self.encoder(queries, self.bev_position(), centres, features, visible, history)
        decoded = self.decoder(bev)
        boxes = _in_metres(decoded.box_numbers, self.config.grid)
        return {"class_logits": decoded.class_logits, "boxes": boxes, "bev": bev}

    def _features(self, batch: Batch) -> Float[Tensor, "m c h w"]:
        method = self.method
        context = method.prepare(batch.cameras)
        features = self.backbone(method.image(batch.images, context))
        modulated = [
            method.modulate(f"backbone_{stride}", x, context) for stride, x in zip(self.config.strides, features, strict=True)
        ]
        narrowed: Tensor = self.narrow(method.modulate("neck", self.neck(modulated), context))
        return narrowed

    def _bev_from_ego(self, batch: Batch) -> Float[Tensor, "b 4 4"]:
        """The frame of the grid, float64: the augmented ego frame, or the LiDAR's for released weights."""
        matrix = torch.eye(4, dtype=torch.float64, device=batch.images.device).repeat(batch.num_samples, 1, 1)
        matrix[:, :3, :3] = batch.bev_from_ego.double()
        if self.config.released is not None:
            matrix = torch.from_numpy(self.config.released.ego_from_lidar.inverse().matrix.copy()).to(matrix) @ matrix
        return matrix

    def _visible(self, batch: Batch, bev_from_ego: Float[Tensor, "b 4 4"]) -> VisibleQueries:
        config, cameras = self.config, batch.cameras
        first_pixel = 0.5 if config.released is None else config.released.first_pixel
        projection = image_from_bev(cameras, bev_from_ego, batch.sample_index, first_pixel)
        anchors = pillar_anchors(config.grid, config.anchor_heights_m, cameras.K.device)
        views = project_pillars(anchors, projection, (cameras.height_px, cameras.width_px))
        return VisibleQueries.of(views, batch.sample_index, batch.num_samples)


def align_history(
    previous_bev: Float[Tensor, "b q c"], previous_from_current: Float[Tensor, "b 4 4"], grid: BevGrid
) -> BevHistory:
    """The previous bird's-eye view moved to the present one: bilinear, zero where it did not reach.

    Args:
        previous_bev: features, row by row.
        previous_from_current: from the present to the previous BEV frame.
        grid: the grid of both.
    """
    centres = cell_centres(grid, previous_bev.device)
    ground = pillar_anchors(grid, (0.0,), previous_bev.device)[:, 0].double()
    moved = torch.einsum("bij,qj->bqi", previous_from_current[:, :2, :3].double(), ground)
    moved = moved + previous_from_current[:, None, :2, 3].double()
    where = (moved / grid.half_extent_m).to(previous_bev.dtype)[:, None]
    maps = previous_bev.transpose(1, 2).reshape(len(previous_bev), -1, grid.side, grid.side)
    aligned = F.grid_sample(maps, where, padding_mode="zeros", align_corners=False)[:, :, 0].transpose(1, 2)
    return BevHistory(aligned, centres.expand(len(previous_bev), -1, -1))


def _in_metres(numbers: Float[Tensor, "l b n 10"], grid: BevGrid) -> Float[Tensor, "l b n 10"]:
    plane = numbers[..., :2] * (2 * grid.half_extent_m) - grid.half_extent_m
    low, high = grid.z_edges_m[0], grid.z_edges_m[-1]
    height = numbers[..., 4:5] * (high - low) + low
    return torch.cat([plane, numbers[..., 2:4], height, numbers[..., 5:]], dim=-1)


def _initialise(transformer: nn.Module) -> None:
    # Xavier for every matrix, then the sampling plans back to their own start, which must be looked at before it is learned
    for module in transformer.modules():
        if isinstance(module, nn.Linear):
            nn.init.xavier_uniform_(module.weight)
    for module in transformer.modules():
        if isinstance(module, SamplingPlan):
            module.reset_parameters()
