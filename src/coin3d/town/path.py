"""Planar polylines that lanes, pavements and the ego route follow."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike


@dataclass(frozen=True, eq=False)
class Path:
    """A polyline in the ground plane.

    Args:
        points_m: (N, 2), N >= 2, without repeated neighbours.
    """

    points_m: Float[np.ndarray, "n 2"]

    @cached_property
    def arc_m(self) -> Float[np.ndarray, "n"]:
        """Distance along the path at every point."""
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.points_m, axis=0), axis=1))])

    @property
    def length_m(self) -> float:
        return float(self.arc_m[-1])

    @cached_property
    def directions(self) -> Float[np.ndarray, "n 2"]:
        """Unit tangent at every point."""
        tangent = np.gradient(self.points_m, axis=0)
        return np.asarray(tangent / np.linalg.norm(tangent, axis=1, keepdims=True))

    def at(self, s_m: ArrayLike) -> Float[np.ndarray, "... 2"]:
        """Position at a distance along the path; straight continuation beyond the ends."""
        s = np.asarray(s_m, dtype=np.float64)
        inside = np.clip(s, 0, self.length_m)
        xy = np.stack([np.interp(inside, self.arc_m, self.points_m[:, k]) for k in (0, 1)], axis=-1)
        over = s - inside
        end = np.where((over > 0)[..., None], self.directions[-1], self.directions[0])
        return np.asarray(xy + over[..., None] * end)

    def yaw_at(self, s_m: ArrayLike, half_base_m: float = 1.3) -> Float[np.ndarray, "..."]:
        """Heading of a body whose two axles, ``half_base_m`` before and behind, both ride on the path."""
        s = np.asarray(s_m, dtype=np.float64)
        chord = self.at(s + half_base_m) - self.at(s - half_base_m)
        return np.asarray(np.arctan2(chord[..., 1], chord[..., 0]))

    def offset(self, left_m: float) -> Path:
        """The parallel path ``left_m`` to the left (negative: to the right)."""
        normal = np.stack([-self.directions[:, 1], self.directions[:, 0]], axis=1)
        return Path(self.points_m + left_m * normal)

    def reversed(self) -> Path:
        return Path(self.points_m[::-1].copy())

    def part(self, start_m: float, end_m: float) -> Path:
        """The stretch between two distances, resampled at about one metre."""
        count = max(2, int(np.ceil(end_m - start_m)) + 1)
        return Path(self.at(np.linspace(start_m, end_m, count)))

    def nearest_m(self, point_m: ArrayLike) -> float:
        """Distance along the path of the vertex nearest to a point."""
        return float(self.arc_m[np.argmin(np.linalg.norm(self.points_m - np.asarray(point_m), axis=1))])


def joined(first: Path, second: Path) -> Path:
    """``first`` and then ``second``, connected by a curve that leaves and meets both smoothly."""
    p0, p1 = first.points_m[-1], second.points_m[0]
    d0, d1 = first.directions[-1], second.directions[0]
    reach = 0.55 * np.linalg.norm(p1 - p0)
    t = np.linspace(0, 1, max(4, int(np.linalg.norm(p1 - p0) * 1.3)))[1:-1, None]
    a, b = p0 + reach * d0, p1 - reach * d1
    bend = (1 - t) ** 3 * p0 + 3 * (1 - t) ** 2 * t * a + 3 * (1 - t) * t**2 * b + t**3 * p1
    return Path(np.concatenate([first.points_m, bend, second.points_m]))
