"""The frame released query detectors predict in: that of nuScenes' LiDAR."""

from __future__ import annotations

import math
from dataclasses import dataclass

from coin3d.geometry import Pose


@dataclass(frozen=True)
class ReleasedLidar:
    """A fixed place relative to the ego, so that vehicles with another LiDAR, or without, have the frame too.

    Args:
        position_m: in the ego frame.
        yaw_rad: heading of its x axis (right of the vehicle) in the ego frame.
    """

    position_m: tuple[float, float, float] = (0.943713, 0.0, 1.84023)
    yaw_rad: float = -math.pi / 2

    @property
    def ego_from_lidar(self) -> Pose:
        """Upright: x right, y forward."""
        return Pose.from_euler(self.yaw_rad, 0.0, 0.0, self.position_m)
