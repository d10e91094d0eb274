"""Fisheye lenses: the Kannala-Brandt model as OpenCV's ``fisheye`` module defines it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from coin3d.geometry.lens import first_zero, require_field, require_finite

_STEPS = 60
_CONVERGED = 1e-14


@dataclass(frozen=True)
class Fisheye:
    """Distance from the principal point grows with the angle theta to the optical axis.

    It is

        theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)

    Rays may lean back by more than 90 degrees. ``angle_rad`` is how far the polynomial rises, at most 180 degrees; beyond it
    rays are NaN.

    Args:
        k1, k2, k3, k4: coefficients; all zero is the equidistant lens.

    Raises:
        ValueError: a coefficient that is not finite, or coefficients that describe less than half a degree.
    """

    k1: float
    k2: float
    k3: float
    k4: float
    angle_rad: float = field(init=False, compare=False)
    """The largest angle to the optical axis that the model describes."""

    def __post_init__(self) -> None:
        for name in ("k1", "k2", "k3", "k4"):
            object.__setattr__(self, name, float(getattr(self, name)))
        require_finite("fisheye", dict(zip(("k1", "k2", "k3", "k4"), self.coefficients, strict=True)))
        object.__setattr__(self, "angle_rad", first_zero(self._slope, np.linspace(0, np.pi, 4097)))
        require_field("fisheye", self.angle_rad, self.coefficients)

    @property
    def coefficients(self) -> tuple[float, ...]:
        """k1 k2 k3 k4, as OpenCV takes them."""
        return self.k1, self.k2, self.k3, self.k4

    def plane_from_ray(self, rays_cam: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 2"]:
        """NaN beyond ``angle_rad``. Rays with z <= 0 are described too, though ``Camera.project`` does not ask for them."""
        rays = np.asarray(rays_cam, dtype=np.float64)
        shape, rays = rays.shape, rays.reshape(-1, 3)
        across = np.hypot(rays[:, 0], rays[:, 1])
        theta = np.arctan2(across, rays[:, 2])
        with np.errstate(all="ignore"):
            bent = np.where(theta < self.angle_rad, self._bent(theta), np.nan)
            # towards the axis bent / across tends to 1 / z
            scale = np.where(across > 0, bent / across, np.where(rays[:, 2] > 0, 1 / rays[:, 2], np.nan))
            return np.asarray(rays[:, :2] * scale[:, None]).reshape(*shape[:-1], 2)

    def ray_from_plane(self, plane: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "... 3"]:
        """A ray of length 1; it looks back (z < 0) where the lens does."""
        plane = np.asarray(plane, dtype=np.float64)
        flat = plane.reshape(-1, 2)
        length = np.hypot(*flat.T)
        theta = self._unbent(length)
        with np.errstate(all="ignore"):
            across = np.where(length == 0, 1.0, np.sin(theta) / length)
        rays = np.concatenate([flat * across[:, None], np.cos(theta)[:, None]], axis=-1)
        return rays.reshape(*plane.shape[:-1], 3)

    def _unbent(self, lengths: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Angles theta by Newton's method between bounds that are halved where it would leave them; NaN where there is none."""
        grid = np.linspace(0, self.angle_rad, 1025)
        bent = self._bent(grid)
        theta = np.interp(lengths, bent, grid)
        place = np.clip(np.searchsorted(bent, lengths), 1, len(grid) - 1)
        low, high = grid[place - 1], grid[place]
        with np.errstate(all="ignore"):
            for _ in range(_STEPS):
                miss = self._bent(theta) - lengths
                if not np.any(np.abs(miss) > _CONVERGED * (1 + lengths)):
                    break
                low, high = np.where(miss < 0, theta, low), np.where(miss > 0, theta, high)
                newton = theta - miss / self._slope(theta)
                theta = np.where((newton >= low) & (newton <= high), newton, (low + high) / 2)
        return np.where(lengths < bent[-1], theta, np.nan)

    def _bent(self, theta: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        square = theta * theta
        bent: np.ndarray = theta * (1 + square * (self.k1 + square * (self.k2 + square * (self.k3 + square * self.k4))))
        return bent

    def _slope(self, theta: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        square = theta * theta
        slope: np.ndarray = 1 + square * (3 * self.k1 + square * (5 * self.k2 + square * (7 * self.k3 + square * 9 * self.k4)))
        return slope
