"""Lens models: how a ray in the camera frame meets the image plane before the intrinsic matrix K is applied.

A lens is a small value object with two functions, each the inverse of the other. ``Camera`` knows nothing else about it,
so another lens is another class: ``lens_brown_conrady.py``, ``lens_fisheye.py``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float


@runtime_checkable
class Lens(Protocol):
    """Maps between rays of the camera frame (x right, y down, z forward) and the image plane at K = I."""

    def plane_from_ray(self, rays_cam: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 2"]:
        """Image-plane position of rays or points in front of the camera; NaN for rays that the model does not describe."""
        ...

    def ray_from_plane(self, plane: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "... 3"]:
        """A ray (any length) that meets the image plane there; NaN where none does."""
        ...

    def __hash__(self) -> int:
        """A lens is a value: what is computed from it is remembered by it."""
        ...


@dataclass(frozen=True)
class Pinhole:
    """No distortion: (x / z, y / z)."""

    def plane_from_ray(self, rays_cam: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 2"]:
        plane: np.ndarray = rays_cam[..., :2] / rays_cam[..., 2:]
        return plane

    def ray_from_plane(self, plane: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "... 3"]:
        return np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1)


def first_zero(function: Callable[[Float[np.ndarray, "n"]], Float[np.ndarray, "n"]], grid: Float[np.ndarray, "n"]) -> float:
    """Where a function that starts positive stops being so, from below; the end of the grid if it never does.

    Distortion polynomials are searched on a grid and not by the roots of their coefficients, because calibrations hold
    coefficients of any size and a companion matrix of such numbers can overflow.

    Args:
        function: vectorised; not positive and not a number both count as the end.
        grid: (N,) ascending places to look at.
    """
    with np.errstate(all="ignore"):
        positive = function(grid) > 0
        if positive.all():
            return float(grid[-1])
        for _ in range(4):
            after = max(int(np.argmin(positive)), 1)
            grid = np.linspace(grid[after - 1], grid[after], len(grid))
            positive = function(grid) > 0
            if positive.all():
                break
    return float(grid[max(int(np.argmin(positive)) - 1, 0)])


def require_finite(name: str, coefficients: dict[str, float]) -> None:
    """Refuse a lens whose coefficients are not numbers.

    Raises:
        ValueError: naming the coefficients.
    """
    if bad := [key for key, value in coefficients.items() if not np.isfinite(value)]:
        raise ValueError(f"the {name} lens has a coefficient that is not finite ({', '.join(bad)}): check the calibration")


def require_field(name: str, angle_rad: float, coefficients: tuple[float, ...]) -> None:
    """Refuse a lens whose model ends right beside the optical axis.

    Raises:
        ValueError: the model describes less than half a degree.
    """
    if angle_rad < np.deg2rad(0.5):
        raise ValueError(
            f"the {name} lens {list(coefficients)} folds back {np.rad2deg(angle_rad):.2g} degrees off its axis: check the "
            "order and the number of the coefficients"
        )
