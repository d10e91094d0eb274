"""Lens models: how a ray in the camera frame meets the image plane before the intrinsic matrix K is applied.

A lens is a small value object with two functions, each the inverse of the other. ``Camera`` knows nothing else about it,
so another lens is another class in this file.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float


@runtime_checkable
class Lens(Protocol):
    """Maps between rays of the camera frame (x right, y down, z forward) and the image plane at K = I."""

    def plane_from_ray(self, rays_cam: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 2"]:
        """Image-plane position of rays or points in front of the camera."""
        ...

    def ray_from_plane(self, plane: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "... 3"]:
        """A ray (any length, z > 0) that meets the image plane there."""
        ...


@dataclass(frozen=True)
class Pinhole:
    """No distortion: (x / z, y / z)."""

    def plane_from_ray(self, rays_cam: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 2"]:
        plane: np.ndarray = rays_cam[..., :2] / rays_cam[..., 2:]
        return plane

    def ray_from_plane(self, plane: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "... 3"]:
        return np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1)
