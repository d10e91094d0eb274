"""Height of the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from coin3d.geometry import Pose


@dataclass(frozen=True, eq=False)
class Terrain:
    """A sum of long waves; without waves the ground is the plane z = 0.

    Args:
        waves: (K, 4) rows of wave vector (x, y) in rad/m, phase in rad, amplitude in m.
    """

    waves: Float[np.ndarray, "k 4"]

    @classmethod
    def flat(cls) -> Terrain:
        return cls(np.zeros((0, 4)))

    @classmethod
    def hilly(cls, rng: np.random.Generator) -> Terrain:
        """Three waves of 90 to 260 m, together at most about 7 % steep."""
        rows = []
        for length_m in (rng.uniform(180, 260), rng.uniform(120, 180), rng.uniform(90, 120)):
            k, angle = 2 * np.pi / length_m, rng.uniform(0, 2 * np.pi)
            steepness = rng.uniform(0.012, 0.028)
            rows.append([k * np.cos(angle), k * np.sin(angle), rng.uniform(0, 2 * np.pi), steepness / k])
        return cls(np.array(rows))

    @property
    def is_flat(self) -> bool:
        return len(self.waves) == 0

    def height_m(self, xy: ArrayLike) -> Float[np.ndarray, "..."]:
        """Ground height at positions (..., 2)."""
        xy = np.asarray(xy, dtype=np.float64)
        height = np.zeros(xy.shape[:-1])
        for kx, ky, phase, amplitude in self.waves:
            height += amplitude * np.sin(kx * xy[..., 0] + ky * xy[..., 1] + phase)
        return height

    def standing(self, x_m: float, y_m: float, yaw_rad: float, wheelbase_m: float = 2.7, track_m: float = 1.5) -> Pose:
        """``world_from_ego`` of a car whose rear axle is above (x, y) and whose four wheels follow the ground."""
        forward = np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
        left = np.array([-forward[1], forward[0]])
        rear = np.array([x_m, y_m])
        z = self.height_m(np.stack([rear, rear + wheelbase_m * forward, rear + track_m / 2 * left, rear - track_m / 2 * left]))
        x_axis = np.append(forward, (z[1] - z[0]) / wheelbase_m)
        y_axis = np.append(left, (z[2] - z[3]) / track_m)
        x_axis /= np.linalg.norm(x_axis)
        z_axis = np.cross(x_axis, y_axis)
        z_axis /= np.linalg.norm(z_axis)
        return Pose(np.column_stack([x_axis, np.cross(z_axis, x_axis), z_axis]), np.array([x_m, y_m, z[0]]))
