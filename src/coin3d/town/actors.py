"""Whoever moves, could move, and is annotated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from coin3d.town.mesh import Mesh
from coin3d.town.path import Path


@dataclass(frozen=True)
class Travel:
    """Distance covered over time: cruising with a slight swing in speed, braking to a stop if there is a stop.

    Args:
        speed_mps: cruising speed.
        swing_m: amplitude of the swing about steady motion.
        swing_rate: its rate in rad/s.
        stop_after_m: where it comes to a halt.
    """

    speed_mps: float
    swing_m: float = 0.0
    swing_rate: float = 0.5
    stop_after_m: float = np.inf

    BRAKE_MPS2 = 2.2

    def distance_m(self, time_s: ArrayLike) -> Float[np.ndarray, "..."]:
        t = np.asarray(time_s, dtype=np.float64)
        if not np.isfinite(self.stop_after_m):
            return np.asarray(self.speed_mps * t + self.swing_m * np.sin(self.swing_rate * t))
        # the way left may be shorter than the usual braking distance: then it has been braking already
        speed = min(self.speed_mps, np.sqrt(2 * self.BRAKE_MPS2 * max(self.stop_after_m, 0.0)))
        if speed <= 0:
            return np.zeros_like(t)
        braking = speed**2 / (2 * self.BRAKE_MPS2)
        begin = (self.stop_after_m - braking) / speed
        late = np.clip(t - begin, 0, speed / self.BRAKE_MPS2)
        return np.asarray(speed * np.minimum(t, begin) + speed * late - self.BRAKE_MPS2 / 2 * late**2)


@dataclass(frozen=True, eq=False)
class Actor:
    """One annotated road user.

    Args:
        name: unique in the town, the same at all times and for all rigs.
        category: nuScenes category.
        size_m: (3,) length, width, height.
        path: what its middle follows.
        start_m: position along the path at time 0.
        travel: how far it has come.
        postures: meshes in the body frame (origin on the ground below the middle); more than one for a gait.
        stride_m: distance over which the postures repeat.
        attribute: nuScenes attribute, "" for none.
        half_base_m: half the distance between its axles.
    """

    name: str
    category: str
    size_m: Float[np.ndarray, "3"]
    path: Path
    start_m: float
    travel: Travel
    postures: tuple[Mesh, ...]
    stride_m: float = 1.0
    attribute: str = ""
    half_base_m: float = 1.3

    @property
    def is_still(self) -> bool:
        """Whether it stands all the time and can be part of the static geometry."""
        return self.travel.speed_mps == 0

    def along_m(self, time_s: ArrayLike) -> Float[np.ndarray, "..."]:
        return np.asarray(self.start_m + self.travel.distance_m(time_s))

    def pose(self, time_s: ArrayLike) -> tuple[Float[np.ndarray, "... 2"], Float[np.ndarray, "..."]]:
        """Position (x, y) and heading."""
        s = self.along_m(time_s)
        return self.path.at(s), self.path.yaw_at(s, self.half_base_m)

    def present(self, time_s: ArrayLike) -> np.ndarray:
        """Whether it is still on its path; past the end it has left town."""
        s = self.along_m(time_s)
        return np.asarray((s >= 0) & (s <= self.path.length_m))

    def posture(self, time_s: float) -> Mesh:
        phase = (float(self.along_m(time_s)) / self.stride_m) % 1.0
        return self.postures[int(phase * len(self.postures)) % len(self.postures)]


def overlap(
    centre_a: Float[np.ndarray, "t 2"],
    yaw_a: Float[np.ndarray, "t"],
    size_a: Float[np.ndarray, "2"],
    centre_b: Float[np.ndarray, "t 2"],
    yaw_b: Float[np.ndarray, "t"],
    size_b: Float[np.ndarray, "2"],
) -> np.ndarray:
    """At which times two rectangles (length, width) in the plane overlap, by separating axes."""
    offset = centre_b - centre_a
    axes_a = np.stack([np.stack([np.cos(yaw_a), np.sin(yaw_a)], -1), np.stack([-np.sin(yaw_a), np.cos(yaw_a)], -1)], 1)
    axes_b = np.stack([np.stack([np.cos(yaw_b), np.sin(yaw_b)], -1), np.stack([-np.sin(yaw_b), np.cos(yaw_b)], -1)], 1)
    apart = np.zeros(len(offset), dtype=bool)
    for axis in (axes_a[:, 0], axes_a[:, 1], axes_b[:, 0], axes_b[:, 1]):
        reach = sum(
            np.abs((axes[:, k] * axis).sum(-1)) * size[k] / 2
            for axes, size in ((axes_a, size_a), (axes_b, size_b))
            for k in (0, 1)
        )
        apart |= np.abs((offset * axis).sum(-1)) > reach
    return ~apart
