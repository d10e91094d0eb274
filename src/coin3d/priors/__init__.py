"""Spatial prior maps of a rig and the layer that brings them into features (paper section 4.1). Pages: docs/method.md."""

from coin3d.priors.cache import PriorCache
from coin3d.priors.channels import CHANNEL_NAMES, PRIOR_CHANNELS, PriorSet
from coin3d.priors.maps import PriorOptions, downsample, prior_maps
from coin3d.priors.modulation import Projector, SpatialModulation
from coin3d.priors.released import ReleasedConventions, released_maps

__all__ = [
    "CHANNEL_NAMES",
    "PRIOR_CHANNELS",
    "PriorCache",
    "PriorOptions",
    "PriorSet",
    "Projector",
    "ReleasedConventions",
    "SpatialModulation",
    "downsample",
    "prior_maps",
    "released_maps",
]
