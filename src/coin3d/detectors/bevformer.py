"""BEVFormer: image trunk -> neck -> bird's-eye-view queries that look into the images -> object queries that look into those.

The top-down paradigm, layer by layer as spec detectors 2. Boxes and bird's-eye view are in the ego frame; history is optional
and enters through ego poses only. The method of transfer enters through the hooks of ``Method`` only.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from coin3d.detectors.backbone import ImageBackbone
from coin3d.detectors.batch import Batch
from coin3d.detectors.bev_history import BevHistory, align_history
from coin3d.detectors.bevformer_config import BEVFormerConfig
from coin3d.detectors.bevformer_encoder import BevFormerEncoder, LearnedPosition
from coin3d.detectors.center_head import CenterHead
from coin3d.detectors.center_targets import center_losses, center_targets
from coin3d.detectors.deformable_attention import SamplingPlan
from coin3d.detectors.image_feature import attach_neck, image_feature
from coin3d.detectors.method import Method
from coin3d.detectors.object_seeds import ObjectSeeds, centre_boxes
from coin3d.detectors.perspective import PerspectiveHead
from coin3d.detectors.pillar_projection import cell_centres, image_from_bev, pillar_anchors, project_pillars
from coin3d.detectors.query_decoder import BevQueryDecoder
from coin3d.detectors.query_detector import QueryDetector
from coin3d.detectors.released_bevformer import ReleasedParts
from coin3d.detectors.rig_memory import RigMemory
from coin3d.detectors.spatial_cross_attention import VisibleQueries

CENTRES = "centres_"
"""Outputs of the dense head begin with this."""


class BEVFormer(QueryDetector):
    """The detector.

    Args:
        config: sizes.
        classes: names of the classes, in the order of the logits.
        method: the method of transfer; it is attached to this detector and becomes part of its weights.
    """

    name = "bevformer"
    config: BEVFormerConfig

    def __init__(self, config: BEVFormerConfig, classes: tuple[str, ...], method: Method) -> None:
        super().__init__()
        self.config, self.classes, self.method = config, classes, method
        self.backbone = ImageBackbone(
            config.backbone, config.strides, method.extra_image_channels, config.pretrained, config.backbone_blocks
        )
        self.neck, modulated_channels = attach_neck(method, self.backbone, config.strides, config.channels)
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
            config.looks_at_anchors,
        )
        self.decoder = BevQueryDecoder(
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
        self._seen: RigMemory[VisibleQueries] = RigMemory()
        self.perspective = PerspectiveHead(modulated_channels, config.channels) if config.perspective_weight else None
        self.centres = CenterHead(config.channels, len(classes), config.channels // 2) if config.seeds else None
        self.seeds = ObjectSeeds(config.channels, config.channels, len(classes)) if config.seeds else None
        _initialise(self.encoder)
        _initialise(self.decoder)
        self.decoder.start_near_references()

    def forward(
        self,
        batch: Batch,
        previous_bev: Float[Tensor, "b q c"] | None = None,
        previous_from_current: Float[Tensor, "b 4 4"] | None = None,
        bus: Float[Tensor, "b 18"] | None = None,
    ) -> dict[str, Tensor]:
        """Predictions of L decoder layers for N object queries, and the bird's-eye view of Q cells, row by row.

        Args:
            batch: the present frames; without ``previous_bev``, frames before that it brings along are looked at first.
            previous_bev: ``bev`` of the frames before, made with the same BEV augmentation; None for single frames.
            previous_from_current: poses of the present ego frames in the previous ones; needed with ``previous_bev``.
            bus: for released weights only, the vehicle's own numbers (see ``ReleasedBevFormer``) instead of what the
                poses tell.

        Returns:
            ``class_logits`` (L, B, N, K); ``boxes`` (L, B, N, 10, see query_boxes) in the BEV frame; ``bev`` (B, Q, C); in
            training, where it is supervised, ``perspective`` (M, 6, h, w). With seeds also the maps of the dense head.

        Raises:
            ValueError: history without motion, or bus numbers for a model that reads none.
        """
        if previous_bev is None and batch.previous is not None:
            previous_bev, previous_from_current = self._bev_of_before(batch.previous), batch.previous_from_ego
        neck_feature, _ = image_feature(self.method, self.backbone, self.neck, self.config.strides, batch)
        bev_from_ego = self._bev_from_ego(batch)
        features: Tensor = self.narrow(neck_feature)
        if self.released is None:
            if bus is not None:
                raise ValueError("only released weights read the vehicle's bus; give previous_from_current alone")
            queries = self.bev_queries.expand(batch.num_samples, -1, -1)
            history = self._history(previous_bev, previous_from_current, bev_from_ego)
        else:
            features = self.released.features(features, batch.cameras.ego_from_cam)
            queries, history = self.released.queries(
                self.bev_queries, previous_bev, previous_from_current, bus, batch.num_samples
            )
        centres, visible = cell_centres(self.config.grid, features.device), self._visible(batch, bev_from_ego)
        bev = self.encoder(queries, self.bev_position(), centres, features, visible, history)
        outputs, seeds = {"bev": bev}, None
        if self.centres is not None and self.seeds is not None:
            grid = self.config.grid
            bev_map = bev.transpose(1, 2).unflatten(2, (grid.side, grid.side))
            maps = self.centres(bev_map)
            outputs |= {CENTRES + name: values for name, values in maps.items()}
            seeds = self.seeds(centre_boxes(maps, bev_map, grid, self.config.seeds), self.config.box_space)
        outputs["class_logits"], outputs["boxes"] = self.decoder(bev, self.config.box_space, seeds)
        if self.perspective is not None and self.training:
            outputs["perspective"] = self.perspective(neck_feature)
        return outputs

    def losses(self, batch: Batch) -> dict[str, Float[Tensor, ""]]:
        """Weighted losses by name; their sum is what is minimised."""
        outputs = self(batch)
        losses = self.losses_of(outputs, batch)
        if self.centres is not None:
            maps = {name.removeprefix(CENTRES): values for name, values in outputs.items() if name.startswith(CENTRES)}
            targets = center_targets(batch.boxes, self.classes, self.config.grid, min_radius_cells=1)
            losses |= center_losses(maps, targets.to(batch.images.device))
        return losses

    @torch.no_grad()
    def _bev_of_before(self, before: Batch) -> Float[Tensor, "b q c"]:
        # as it will be when detecting: earlier frames are not learned from, nor do they enter the statistics of batch norm
        training = self.training
        self.eval()
        try:
            bev: Tensor = self(before)["bev"]
        finally:
            self.train(training)
        return bev

    def _bev_from_ego(self, batch: Batch) -> Float[Tensor, "b 4 4"]:
        """The frame of the grid, float64: the augmented ego frame, or the LiDAR's for released weights."""
        matrix = torch.eye(4, dtype=torch.float64, device=batch.images.device).repeat(batch.num_samples, 1, 1)
        matrix[:, :3, :3] = batch.bev_from_ego.double()
        if self.config.released is not None:
            matrix = torch.from_numpy(self.config.released.lidar.ego_from_lidar.inverse().matrix.copy()).to(matrix) @ matrix
        return matrix

    def _history(
        self,
        previous_bev: Float[Tensor, "b q c"] | None,
        previous_from_current: Float[Tensor, "b 4 4"] | None,
        bev_from_ego: Float[Tensor, "b 4 4"],
    ) -> BevHistory | None:
        if previous_bev is None:
            return None
        if previous_from_current is None:
            raise ValueError("previous_bev needs previous_from_current: how the ego vehicle moved since")
        moved = bev_from_ego @ previous_from_current.double() @ torch.linalg.inv(bev_from_ego)
        return align_history(previous_bev, moved, self.config.grid)

    def _visible(self, batch: Batch, bev_from_ego: Float[Tensor, "b 4 4"]) -> VisibleQueries:
        if torch.is_grad_enabled():
            return self._visible_now(batch, bev_from_ego)
        return self._seen.get(batch, lambda: self._visible_now(batch, bev_from_ego))

    def _visible_now(self, batch: Batch, bev_from_ego: Float[Tensor, "b 4 4"]) -> VisibleQueries:
        config, cameras = self.config, batch.cameras
        first_pixel = 0.5 if config.released is None else config.released.first_pixel
        projection = image_from_bev(cameras, bev_from_ego, batch.sample_index, first_pixel)
        anchors = pillar_anchors(config.grid, config.anchor_heights_m, cameras.K.device)
        views = project_pillars(anchors, projection, (cameras.height_px, cameras.width_px))
        return VisibleQueries.of(views, batch.sample_index, batch.num_samples)


def _initialise(transformer: nn.Module) -> None:
    # Xavier for every matrix, then the sampling plans back to their own start, which must be looked at before it is learned
    for module in transformer.modules():
        if isinstance(module, nn.Linear):
            nn.init.xavier_uniform_(module.weight)
    for module in transformer.modules():
        if isinstance(module, SamplingPlan):
            module.reset_parameters()
