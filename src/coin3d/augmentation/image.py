"""Generic image augmentation: mirror and turn, with the camera following (BEVDepth's IDA without its resize)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coin3d.augmentation.view import View
from coin3d.geometry.image_transform import flipped, rotated


@dataclass(frozen=True)
class ImageAugmentation:
    """Each view on its own: mirrored with a probability, turned about its centre (spec official_code 3.5).

    Args:
        flip_probability: chance of a left-right mirror.
        max_rotation_deg: turn drawn uniformly within plus or minus this.
    """

    flip_probability: float = 0.5
    max_rotation_deg: float = 5.4

    def __call__(self, view: View, rng: np.random.Generator) -> View:
        flip = rng.random() < self.flip_probability
        angle = np.deg2rad(rng.uniform(-self.max_rotation_deg, self.max_rotation_deg))
        transform = flipped(view.transform) if flip else view.transform
        if angle != 0:
            transform = rotated(transform, float(angle))
        return replace(view, transform=transform)
