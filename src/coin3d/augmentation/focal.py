"""Focal augmentation of raw images (paper F-Aug): zoom about the principal point, focal length follows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coin3d.augmentation.view import View
from coin3d.geometry.image_transform import zoomed


@dataclass(frozen=True)
class FocalAugmentation:
    """Multiplies the focal length of each view by a ratio drawn uniformly (paper supplement: 0.7 to 1.4).

    Below 1 the image shrinks and a black border remains. LiDAR depth is projected through the new camera afterwards,
    never resampled.
    """

    min_ratio: float = 0.7
    max_ratio: float = 1.4

    def __post_init__(self) -> None:
        if not 0 < self.min_ratio <= self.max_ratio:
            raise ValueError(f"focal ratios are 0 < min <= max, got {self.min_ratio} and {self.max_ratio}")

    def __call__(self, view: View, rng: np.random.Generator) -> View:
        ratio = float(rng.uniform(self.min_ratio, self.max_ratio))
        return replace(view, transform=zoomed(view.transform, view.camera, ratio))
