"""Augmentation of the bird's-eye view: it enters the lift and the boxes, never the cameras or the priors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from coin3d.geometry import Boxes3D, wrap_angle


@dataclass(frozen=True)
class BevAugmentation:
    """Random rotation, scale and mirror of the ego plane (spec official_code 1.1, 1.7).

    Args:
        max_rotation_deg: turn about z within plus or minus this.
        min_scale: smallest scale.
        max_scale: largest scale.
        flip_probability: chance of a mirror, for x and for y.
    """

    max_rotation_deg: float = 22.5
    min_scale: float = 0.95
    max_scale: float = 1.05
    flip_probability: float = 0.5

    def draw(self, rng: np.random.Generator) -> Float[np.ndarray, "3 3"]:
        """``bev_from_ego`` = flip @ scale @ rotation."""
        angle = np.deg2rad(rng.uniform(-self.max_rotation_deg, self.max_rotation_deg))
        scale = rng.uniform(self.min_scale, self.max_scale)
        signs = np.where(rng.random(2) < self.flip_probability, -1.0, 1.0)
        c, s = np.cos(angle), np.sin(angle)
        rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        return np.asarray(np.diag([*signs, 1.0]) @ (scale * rotation))


def transform_boxes(boxes: Boxes3D, bev_from_ego: Float[np.ndarray, "3 3"]) -> Boxes3D:
    """Boxes under a similarity of the ego plane (rotation about z, scale, mirrors)."""
    scale = float(np.cbrt(abs(np.linalg.det(bev_from_ego))))
    heading = np.stack([np.cos(boxes.yaw_rad), np.sin(boxes.yaw_rad)], axis=-1) @ bev_from_ego[:2, :2].T
    return replace(
        boxes,
        centre_m=boxes.centre_m @ bev_from_ego.T,
        size_m=boxes.size_m * scale,
        yaw_rad=wrap_angle(np.arctan2(heading[:, 1], heading[:, 0])),
        velocity_mps=boxes.velocity_mps @ bev_from_ego[:2, :2].T,
    )
