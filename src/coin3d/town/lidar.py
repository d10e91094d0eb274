"""A spinning LiDAR."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from coin3d.geometry import Pose
from coin3d.town.mesh import Material
from coin3d.town.raycast import Moment


def _roof_mount() -> Pose:
    # nuScenes LiDAR axes: x right, y forward, z up
    return Pose(np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([0.94, 0.0, 1.84]))


@dataclass(frozen=True, eq=False)
class SpinningLidar:
    """All beams of a turn are cast from one sensor pose, so a sweep is a snapshot.

    Args:
        ego_from_lidar: mount; nuScenes axes by default.
        lowest_deg, highest_deg: elevation of the outer beams.
        beams: number of beams, evenly spaced; ring 0 is the lowest.
        steps: measurements per turn and beam.
        range_m: farthest return.
        noise_m: standard deviation of the range.
        dropout: share of returns lost everywhere.
    """

    ego_from_lidar: Pose = field(default_factory=_roof_mount)
    lowest_deg: float = -30.67
    highest_deg: float = 10.67
    beams: int = 32
    steps: int = 1084
    range_m: float = 90.0
    noise_m: float = 0.015
    dropout: float = 0.03

    def sweep(self, moment: Moment, world_from_ego: Pose, rng: np.random.Generator) -> Float[np.ndarray, "n 5"]:
        """One turn: float32 rows of x, y, z in the sensor frame, intensity 0 to 255, ring."""
        elevation = np.deg2rad(np.linspace(self.lowest_deg, self.highest_deg, self.beams))
        azimuth = 2 * np.pi * (np.arange(self.steps) + rng.random()) / self.steps
        ring = np.repeat(np.arange(self.beams), self.steps)
        e, a = elevation[ring], np.tile(azimuth, self.beams)
        rays = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1)
        world_from_lidar = world_from_ego @ self.ego_from_lidar
        cast = world_from_lidar.rotate(rays).astype(np.float32)
        hits = moment.cast(np.broadcast_to(world_from_lidar.translation.astype(np.float32), cast.shape), cast)
        face = np.maximum(hits.face, 0)
        metres = hits.distance.astype(np.float64)
        facing = np.abs((moment.normal[face] * cast).sum(1))
        material = moment.material[face]
        bright = moment.colour[face].mean(1)
        # glass returns little, dark grazing surfaces fade with distance
        strength = np.clip(bright, 0.03, 1) ** 0.5 * (0.25 + 0.75 * facing)
        lost = self.dropout + np.where(material == Material.GLASS, 0.5, 0.0)
        lost = np.where(metres > 40, np.maximum(lost, 1 - strength * 2.2 * 40 / np.maximum(metres, 1)), lost)
        kept = (hits.face >= 0) & (metres < self.range_m) & (metres > 1.0) & (rng.random(len(metres)) > lost)
        metres = metres + self.noise_m * rng.standard_normal(len(metres))
        intensity = np.round(255 * np.clip(0.35 * strength + 0.03 * rng.standard_normal(len(metres)), 0.004, 1))
        points = rays * np.where(kept, metres, 0)[:, None]
        return np.column_stack([points, intensity, ring])[kept].astype(np.float32)
