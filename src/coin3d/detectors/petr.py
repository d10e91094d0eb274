"""PETR: object queries attend to image cells that know where they look (spec detectors 3).

Image trunk -> neck -> image cells with an embedding of their rays -> decoder of object queries -> boxes. The method of transfer
enters through the hooks of ``Method`` only; nothing but the embedding of rays, which is made of camera matrices, tells one
camera from another.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from coin3d.detectors.backbone import ImageBackbone
from coin3d.detectors.batch import Batch
from coin3d.detectors.image_feature import attach_neck, image_feature
from coin3d.detectors.method import Method
from coin3d.detectors.object_queries import PRIOR_LOGIT, ObjectQueries
from coin3d.detectors.object_seeds import ObjectSeeds
from coin3d.detectors.perspective_bins import BinnedPerspectiveHead
from coin3d.detectors.perspective_votes import perspective_boxes
from coin3d.detectors.petr_config import V2_99, PETRConfig
from coin3d.detectors.petr_decoder import QueryDecoder, gather_samples, sample_padding
from coin3d.detectors.position_embedding_3d import CameraSineEmbedding, PositionEmbedding3D, sine_code
from coin3d.detectors.query_boxes import CODE_SIZE, START_OF_SHIFTS, place_boxes
from coin3d.detectors.query_detector import QueryDetector
from coin3d.detectors.rig_memory import RigMemory
from coin3d.detectors.vovnet import VoVNet99


class PETR(QueryDetector):
    """The detector.

    Args:
        config: sizes.
        classes: names of the classes, in the order of the scores.
        method: the method of transfer; it is attached to this detector and becomes part of its weights.
    """

    name = "petr"
    config: PETRConfig
    perspective: BinnedPerspectiveHead | None

    def __init__(self, config: PETRConfig, classes: tuple[str, ...], method: Method) -> None:
        super().__init__()
        self.config, self.classes, self.method = config, classes, method
        self.backbone: VoVNet99 | ImageBackbone
        if config.backbone == V2_99:
            self.backbone = VoVNet99(config.strides, method.extra_image_channels)
        else:
            self.backbone = ImageBackbone(
                config.backbone, config.strides, method.extra_image_channels, config.pretrained, config.backbone_blocks
            )
        self.neck, modulated_channels = attach_neck(method, self.backbone, config.strides, config.neck_channels)
        width, released = config.channels, config.released
        self.input_proj = nn.Conv2d(modulated_channels, width, 1)
        self.cell_norm = nn.LayerNorm(width) if config.normalised_cells else None
        self.rays = PositionEmbedding3D(
            width, config.strides[0], config.rays, config.ray_space, released.point_in_cell_px if released else None
        )
        self.camera_sine = (
            CameraSineEmbedding(width, released.camera_headings_deg) if released and released.camera_sine else None
        )
        self._positions: RigMemory[Tensor] = RigMemory()
        self.reference_points = nn.Parameter(torch.rand(config.queries, 3))
        codes = len(sine_code(torch.zeros(()))) * 3
        self.query_embedding = nn.Sequential(nn.Linear(codes, width), nn.ReLU(inplace=True), nn.Linear(width, width))
        self.decoder = QueryDecoder(config.layers, width, config.heads, config.hidden, config.dropout)
        self.class_branch = nn.Sequential(
            nn.Linear(width, width),
            nn.LayerNorm(width),
            nn.ReLU(inplace=True),
            nn.Linear(width, width),
            nn.LayerNorm(width),
            nn.ReLU(inplace=True),
            output := nn.Linear(width, len(classes)),
        )
        nn.init.constant_(output.bias, PRIOR_LOGIT)
        self.box_branch = nn.Sequential(
            nn.Linear(width, width),
            nn.ReLU(inplace=True),
            nn.Linear(width, width),
            nn.ReLU(inplace=True),
            start := nn.Linear(width, CODE_SIZE),
        )
        with torch.no_grad():
            start.weight *= START_OF_SHIFTS
        supervised = config.perspective_weight > 0
        self.perspective = BinnedPerspectiveHead(modulated_channels, config.neck_channels) if supervised else None
        self.seeds = ObjectSeeds(modulated_channels, width, len(classes)) if config.seeds else None

    def forward(self, batch: Batch) -> dict[str, Tensor]:
        """``class_logits`` (L, B, Q, classes) and ``boxes`` (L, B, Q, 10, see query_boxes) after each decoder layer.

        In training, where it is supervised, also ``perspective`` (M, 45, h, w), see perspective_bins.
        """
        config = self.config
        feature, _ = image_feature(self.method, self.backbone, self.neck, config.strides, batch)
        h, w = feature.shape[-2:]
        position = self._position(batch) if torch.is_grad_enabled() else self._remembered_position(batch)
        memory, memory_position = (
            gather_samples(x, batch.sample_index, batch.num_samples) for x in (self.input_proj(feature), position)
        )
        if self.cell_norm is not None:
            memory = self.cell_norm(memory)
        padding = sample_padding(batch.sample_index, batch.num_samples, h * w)
        position = self._query_position().expand(batch.num_samples, -1, -1)
        place = self.reference_points.expand(batch.num_samples, -1, -1)
        queries = ObjectQueries.learned(place, position, torch.zeros_like(position), len(self.classes))
        shown = self.perspective(feature) if self.perspective and (self.training or self.seeds) else None
        if self.seeds is not None and self.perspective is not None and shown is not None:
            values, sure = self.perspective.read(shown.detach())
            first = perspective_boxes(values, sure, feature, batch, config.strides[0], config.seeds, len(self.classes))
            queries = queries.joined(self.seeds(first, config.box_space))
        decoded = self.decoder(queries.content, queries.position, memory, memory_position, padding)
        with torch.autocast(decoded.device.type, enabled=False):  # half precision would put boxes on a grid of decimetres
            decoded = decoded.float()
            raw, place = self.box_branch(decoded), queries.place.expand(len(decoded), -1, -1, -1)
            boxes = place_boxes(raw, place, config.box_space, queries.code)
            outputs: dict[str, Tensor] = {"class_logits": self.class_branch(decoded) + queries.logits, "boxes": boxes}
        if self.training and shown is not None:
            outputs["perspective"] = shown
        return outputs

    def _position(self, batch: Batch) -> Float[Tensor, "m c h w"]:
        position: Tensor = self.rays(batch.cameras, self._target_from_ego(batch)[batch.sample_index])
        if self.camera_sine is not None:
            position = position + self.camera_sine(batch.cameras.ego_from_cam, *position.shape[-2:])
        return position

    def _remembered_position(self, batch: Batch) -> Float[Tensor, "m c h w"]:
        embeddings = [self.rays] if self.camera_sine is None else [self.rays, self.camera_sine]
        weights = [w for embedding in embeddings for w in embedding.parameters()]
        return self._positions.get(batch, lambda: self._position(batch), weights)

    def _query_position(self) -> Float[Tensor, "q c"]:
        x, y, z = self.reference_points.unbind(-1)
        out: Tensor = self.query_embedding(torch.cat([sine_code(y), sine_code(x), sine_code(z)], dim=-1))
        return out

    def _target_from_ego(self, batch: Batch) -> Float[Tensor, "b 4 4"]:
        target = torch.eye(4, device=batch.bev_from_ego.device).repeat(batch.num_samples, 1, 1)
        target[:, :3, :3] = batch.bev_from_ego
        if self.config.released is None:
            return target
        lidar_from_bev = torch.tensor(self.config.released.lidar.ego_from_lidar.inverse().matrix, device=target.device)
        return lidar_from_bev.double() @ target.double()
