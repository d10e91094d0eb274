"""CoIn3D: spatial-aware feature modulation of any detector, and the augmentation that feeds it (paper section 4)."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn

from coin3d.augmentation import FocalAugmentation, FrameAugmentation, NovelViewOptions, novel_views
from coin3d.detectors.method import Method
from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.priors import PriorCache, PriorOptions, PriorSet, Projector, SpatialModulation, prior_maps
from coin3d.priors.released import ReleasedConventions, released_prior_maps
from coin3d.rendering.gaussian_folder import GaussianFolder

_CONSTANT_VECTOR = 27


@dataclass(frozen=True)
class CoIn3DOptions:
    """What of CoIn3D is switched on.

    Args:
        placement: ``released`` modulates the backbone levels and the neck, as the released code does; ``paper`` the neck
            only. Both concatenate the maps to the image.
        priors: which of the four priors are used.
        projector: how the priors become an embedding.
        modulate: ``False`` only concatenates the priors (paper table supp_ablation_priors, "Cat").
        focal_augmentation: zoom raw training images (paper F-Aug).
        focal: its range.
        maps: constants of the prior maps; fixed at training time and stored in the checkpoint.
        novel_views: train on rendered views as well (paper CDA).
        released: maps of the released code and its camera-aware gates with constant input, for its weights only.
    """

    placement: Literal["released", "paper"] = "released"
    priors: PriorSet = field(default_factory=PriorSet)
    projector: Projector = "conv3"
    modulate: bool = True
    focal_augmentation: bool = True
    focal: FocalAugmentation = field(default_factory=FocalAugmentation)
    maps: PriorOptions = field(default_factory=PriorOptions)
    novel_views: NovelViewOptions | None = None
    released: ReleasedConventions | None = None


class CoIn3D(Method):
    """SFM through the hooks of a detector; no detector knows about it."""

    def __init__(self, options: CoIn3DOptions | None = None) -> None:
        super().__init__()
        self.options = options = options or CoIn3DOptions()
        self.view_augmentation = options.focal if options.focal_augmentation else None
        self.modulations = nn.ModuleDict()
        self._strides: dict[str, int] = {}
        if options.released is None:
            self._priors = PriorCache(partial(prior_maps, options=options.maps))
        else:
            self._priors = PriorCache(partial(released_prior_maps, conventions=options.released))

    def frame_augmentation(self, gaussians: GaussianFolder | None) -> FrameAugmentation | None:
        return novel_views(self.options.novel_views, gaussians)

    @property
    def camera_vector_channels(self) -> int:
        return 0 if self.options.released is None else _CONSTANT_VECTOR

    def camera_vector(
        self, cameras: CameraTensors, bev_from_ego: Float[Tensor, "m 3 3"], context: Any
    ) -> Float[Tensor, "m 27"] | None:
        """Ones under released conventions, whose gates are so learned constants; else there are no gates."""
        return None if self.options.released is None else torch.ones(len(cameras), _CONSTANT_VECTOR, device=cameras.K.device)

    @property
    def extra_image_channels(self) -> int:
        return len(self.options.priors.channels)

    def attach(self, level: str, channels: int, stride: int) -> int:
        if self.options.placement == "paper" and level != "neck":
            return channels
        o = self.options
        layer = SpatialModulation(channels, o.priors, o.projector, o.modulate)
        self.modulations[level] = layer
        self._strides[level] = stride
        return layer.out_channels

    def prepare(self, cameras: CameraTensors) -> CameraTensors:
        if self.training:
            self._priors.clear()  # augmented cameras never come back, and their maps are large
        return cameras

    def image(self, images: Float[Tensor, "m 3 h w"], context: CameraTensors) -> Float[Tensor, "m c h w"]:
        maps = self._priors.maps(context)[:, list(self.options.priors.channels)]
        return torch.cat([images, maps], dim=1)

    def modulate(self, level: str, features: Float[Tensor, "m c h w"], context: CameraTensors) -> Float[Tensor, "m k h w"]:
        if level not in self._strides:
            return features
        modulated: Tensor = self.modulations[level](features, self._priors.maps(context, self._strides[level]))
        return modulated
