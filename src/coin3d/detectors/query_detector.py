"""What detectors with object queries share: losses after every decoder layer, boxes from the last."""

from __future__ import annotations

from abc import abstractmethod
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from coin3d.detectors.batch import Batch
from coin3d.detectors.detector import Detector, DetectorConfig
from coin3d.detectors.object_seeds import ObjectSeeds
from coin3d.detectors.perspective import PerspectiveHead, perspective_batch_targets
from coin3d.detectors.perspective_bins import BinnedPerspectiveHead
from coin3d.detectors.query_boxes import QueryDecodeOptions, decode_queries
from coin3d.detectors.query_losses import QueryLossWeights, query_losses, query_targets
from coin3d.detectors.released_lidar import ReleasedLidar
from coin3d.detectors.space_range import SpaceRange
from coin3d.geometry import Boxes3D


@runtime_checkable
class HasLidar(Protocol):
    """Conventions of released weights."""

    @property
    def lidar(self) -> ReleasedLidar:
        """The frame their boxes are predicted in."""


@runtime_checkable
class QueryDetectorConfig(DetectorConfig, Protocol):
    """What is read of the configuration of a detector with object queries."""

    @property
    def strides(self) -> tuple[int, ...]:
        """Image feature levels, finest first."""

    @property
    def box_space(self) -> SpaceRange:
        """Range of space in which boxes lie."""

    @property
    def perspective_weight(self) -> float:
        """Of the auxiliary loss on the image feature."""

    @property
    def weights(self) -> QueryLossWeights:
        """Of the losses."""

    @property
    def decode(self) -> QueryDecodeOptions:
        """How boxes are read off."""

    @property
    def released(self) -> HasLidar | None:
        """Only for converted weights: boxes are predicted in the frame of a LiDAR, not in the ego frame."""


class QueryDetector(Detector):
    """A detector of L decoder layers and Q queries.

    Its forward gives ``class_logits`` (L, B, Q, K), ``boxes`` (L, B, Q, 10, see query_boxes) and, in training where it is
    supervised, ``perspective``, what its perspective head says.
    """

    config: QueryDetectorConfig
    perspective: PerspectiveHead | BinnedPerspectiveHead | None
    seeds: ObjectSeeds | None

    @abstractmethod
    def forward(self, batch: Batch) -> dict[str, Tensor]:
        """Predictions of every decoder layer."""

    def losses(self, batch: Batch) -> dict[str, Float[Tensor, ""]]:
        """Weighted losses by name; their sum is what is minimised."""
        return self.losses_of(self(batch), batch)

    def losses_of(self, outputs: dict[str, Tensor], batch: Batch) -> dict[str, Float[Tensor, ""]]:
        """Losses of the decoder and the perspective head."""
        if len(batch.boxes) != batch.num_samples:
            raise ValueError(f"training needs boxes: {len(batch.boxes)} tables of them for {batch.num_samples} samples")
        config, device = self.config, batch.images.device
        tables = [self._in_frame_of_boxes(boxes) for boxes in batch.boxes]
        targets = [query_targets(boxes, self.classes, config.box_space).to(device) for boxes in tables]
        with torch.autocast(device.type, enabled=False):
            losses = query_losses(outputs["class_logits"], outputs["boxes"], targets, config.weights)
            if self.perspective is not None and "perspective" in outputs:
                cells = perspective_batch_targets(batch, config.strides[0])
                losses["perspective"] = config.perspective_weight * self.perspective.loss(outputs["perspective"], cells)
        return losses

    @torch.no_grad()
    def detect(self, batch: Batch) -> list[Boxes3D]:
        """Boxes of each sample in the ego frame (the batch carries no BEV augmentation), best first."""
        outputs, config = self(batch), self.config
        found = decode_queries(
            outputs["class_logits"][-1],
            outputs["boxes"][-1],
            self.classes,
            config.decode,
            with_velocity=config.weights.velocity > 0,
        )
        return (
            found if config.released is None else [boxes.transformed(config.released.lidar.ego_from_lidar) for boxes in found]
        )

    def _in_frame_of_boxes(self, boxes: Boxes3D) -> Boxes3D:
        released = self.config.released
        return boxes if released is None else boxes.transformed(released.lidar.ego_from_lidar.inverse())
