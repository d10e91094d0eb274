"""What the released query detectors assume and detectors trained here do not: in one record, for converted weights only."""

from __future__ import annotations

import math
from dataclasses import dataclass

from coin3d.detectors.camera_seats import NUSCENES_HEADINGS_DEG
from coin3d.geometry import Pose


@dataclass(frozen=True)
class ReleasedQueryConventions:
    """The released conventions that no rearrangement of weights can undo (those are undone when weights are converted).

    Args:
        lidar_in_ego_m: the released detectors predict in the frame of the nuScenes LiDAR (x right, y forward, 1.84 m up); here
            it is a fixed frame relative to the ego, so that other vehicles have one too.
        lidar_yaw_rad: heading of its x axis in the ego frame.
        point_in_cell_px: the pixel whose ray stands for a feature cell, from the cell's upper left corner. The released code
            takes corners in pixels whose first centre is 0; after its resize by 0.5 that is 0.25 here.
        camera_sine: add an embedding of which camera of the rig it is, which ties the weights to nuScenes' rig.
        camera_headings_deg: where the cameras of that rig look, in their order (see ``camera_seats``).
    """

    lidar_in_ego_m: tuple[float, float, float] = (0.943713, 0.0, 1.84023)
    lidar_yaw_rad: float = -math.pi / 2
    point_in_cell_px: float = 0.25
    camera_sine: bool = True
    camera_headings_deg: tuple[float, ...] = NUSCENES_HEADINGS_DEG

    @property
    def ego_from_lidar(self) -> Pose:
        """The frame the weights predict in, upright."""
        return Pose.from_euler(self.lidar_yaw_rad, 0.0, 0.0, self.lidar_in_ego_m)
