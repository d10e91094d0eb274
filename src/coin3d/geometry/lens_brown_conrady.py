"""The distortion of ordinary lenses: Brown-Conrady as OpenCV defines it, with the rational extension."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np
from jaxtyping import Bool, Float

from coin3d.geometry.lens import first_zero, require_field, require_finite

# rays flatter than this (0.006 degrees from the image plane) are given up: no lens of this kind images them
_STEEPEST = 1e4
_STEPS = 100
_CONVERGED = 1e-13


@dataclass(frozen=True)
class BrownConrady:
    """Radial and tangential distortion of (x, y) = (X / Z, Y / Z), in OpenCV's order of coefficients.

    With r^2 = x^2 + y^2 and d = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)

        x' = x d + 2 p1 x y + p2 (r^2 + 2 x^2)
        y' = y d + p1 (r^2 + 2 y^2) + 2 p2 x y

    The formula is fitted to what the image shows. Farther out it usually folds back, and would put points from the side of
    the car into the middle of the image. ``radius`` is how far it can be trusted: up to there the derivative is positive
    definite in every direction (it is symmetric, its smallest eigenvalue is at least min(d, d + r d') - 6 r |(p1, p2)|), so
    on that disc no two rays share an image point. Rays outside are NaN.

    Args:
        k1, k2, k3: radial coefficients.
        p1, p2: tangential coefficients.
        k4, k5, k6: of the denominator (OpenCV's rational model).

    Raises:
        ValueError: a coefficient that is not finite, or coefficients that describe less than half a degree.
    """

    k1: float
    k2: float
    p1: float
    p2: float
    k3: float = 0.0
    k4: float = 0.0
    k5: float = 0.0
    k6: float = 0.0
    radius: float = field(init=False, compare=False)
    """The largest r = tan(angle to the optical axis) that the model describes."""

    def __post_init__(self) -> None:
        for name in _names():
            object.__setattr__(self, name, float(getattr(self, name)))
        require_finite("Brown-Conrady", self._named())
        grid = np.tan(np.linspace(0, np.arctan(_STEEPEST), 4097))
        object.__setattr__(self, "radius", first_zero(self._least_slope, grid))
        require_field("Brown-Conrady", float(np.arctan(self.radius)), self.coefficients)

    @property
    def coefficients(self) -> tuple[float, ...]:
        """k1 k2 p1 p2 k3, and k4 k5 k6 if one of these is not zero: as OpenCV takes them."""
        values = tuple(self._named().values())
        return values if any(values[5:]) else values[:5]

    def plane_from_ray(self, rays_cam: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 2"]:
        """NaN behind the camera and beyond ``radius``."""
        rays = np.asarray(rays_cam, dtype=np.float64)
        with np.errstate(all="ignore"):
            flat = (rays[..., :2] / np.where(rays[..., 2:] > 0, rays[..., 2:], np.nan)).reshape(-1, 2)
            bent = self._distort(np.where(self._inside(flat)[:, None], flat, np.nan))
        return bent.reshape(*rays.shape[:-1], 2)

    def ray_from_plane(self, plane: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "... 3"]:
        """(x, y, 1), by Newton's method: the derivative is positive definite, so a damped step always gets nearer."""
        plane = np.asarray(plane, dtype=np.float64)
        targets = plane.reshape(-1, 2)
        found = np.full(targets.shape, np.nan)
        with np.errstate(all="ignore"):
            # not quite to the end, which may be a pole
            steep = np.tan(np.linspace(0, (1 - 1e-9) * np.arctan(self.radius), 1025))
            bent = steep * self._radial(steep)[0]
            length = np.hypot(*targets.T)
            most = bent[-1] + 3 * np.hypot(self.p1, self.p2) * self.radius**2
            todo = np.flatnonzero(length <= most)
            guess = np.minimum(np.interp(length[todo], bent, steep), 0.999 * self.radius)
            start = targets[todo] * (guess / np.where(length[todo] > 0, length[todo], 1))[:, None]
            found[todo] = self._undistort(targets[todo], start)
        rays = np.concatenate([found, np.where(np.isnan(found[:, :1]), np.nan, 1.0)], axis=-1)
        return rays.reshape(*plane.shape[:-1], 3)

    def _undistort(self, targets: Float[np.ndarray, "n 2"], start: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Points of the disc that distort to the targets, NaN where there are none."""
        here = start.copy()
        miss = self._distort(here) - targets
        error = np.hypot(*miss.T)
        damping = np.ones(len(here))
        enough = _CONVERGED * (1 + np.hypot(*targets.T))
        for _ in range(_STEPS):
            todo = np.flatnonzero(error > enough)
            if not len(todo):
                break
            there = here[todo] - damping[todo, None] * self._newton_step(here[todo], miss[todo])
            miss_there = self._distort(there) - targets[todo]
            error_there = np.hypot(*miss_there.T)
            nearer = self._inside(there) & (error_there < error[todo])
            better = todo[nearer]
            here[better], miss[better], error[better] = there[nearer], miss_there[nearer], error_there[nearer]
            damping[todo] = np.where(nearer, np.minimum(2 * damping[todo], 1), damping[todo] / 2)
        return np.where((error <= 100 * enough)[:, None], here, np.nan)

    def _newton_step(self, flat: Float[np.ndarray, "n 2"], miss: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        x, y = flat.T
        d, slope = self._radial(np.hypot(x, y))
        bend = np.where(x * x + y * y > 0, (slope - d) / (x * x + y * y), 0.0)  # d' / r
        xx = d + bend * x * x + 2 * self.p1 * y + 6 * self.p2 * x
        yy = d + bend * y * y + 6 * self.p1 * y + 2 * self.p2 * x
        xy = bend * x * y + 2 * self.p1 * x + 2 * self.p2 * y
        a, b = miss.T
        step: np.ndarray = np.stack([yy * a - xy * b, xx * b - xy * a], axis=-1) / (xx * yy - xy * xy)[:, None]
        return step

    def _inside(self, flat: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "n"]:
        return np.asarray((flat * flat).sum(-1) < self.radius**2)

    def _distort(self, flat: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        x, y = flat.T
        square = x * x + y * y
        above = 1 + square * (self.k1 + square * (self.k2 + square * self.k3))
        below = 1 + square * (self.k4 + square * (self.k5 + square * self.k6))
        d = above / below
        bent_x = x * d + 2 * self.p1 * x * y + self.p2 * (square + 2 * x * x)
        bent_y = y * d + self.p1 * (square + 2 * y * y) + 2 * self.p2 * x * y
        return np.stack([bent_x, bent_y], axis=-1)

    def _radial(self, r: Float[np.ndarray, "n"]) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
        """The factor d and the derivative of r d by r; NaN where the denominator has changed its sign."""
        square = r * r
        above = 1 + square * (self.k1 + square * (self.k2 + square * self.k3))
        below = 1 + square * (self.k4 + square * (self.k5 + square * self.k6))
        above_by_square = self.k1 + square * (2 * self.k2 + square * 3 * self.k3)
        below_by_square = self.k4 + square * (2 * self.k5 + square * 3 * self.k6)
        below = np.where(below > 0, below, np.nan)
        d = above / below
        return d, d + 2 * square * (above_by_square - d * below_by_square) / below

    def _least_slope(self, r: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        d, slope = self._radial(r)
        return np.asarray(np.minimum(d, slope) - 6 * r * np.hypot(self.p1, self.p2))

    def _named(self) -> dict[str, float]:
        return {name: getattr(self, name) for name in _names()}


def _names() -> list[str]:
    return [f.name for f in fields(BrownConrady) if f.init]
