"""LiDAR sweeps stored as bare float32 records: x, y, z, intensity, ring (nuScenes, Lyft, the town)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coin3d.datasets.frame import LidarScan
from coin3d.datasets.lyft_files import CUT_SHORT
from coin3d.geometry import Pose

_FLOATS_PER_POINT = 5
_FLOATS_LEFT_OVER = 3  # of the last point of one published file


@dataclass(frozen=True, eq=False)
class LidarFile:
    """A sweep on disk, read when asked for.

    Args:
        path: the file.
        ego_from_lidar: from the sensor at the time of the sweep to the ego frame of the ``Frame`` that owns the
            sweep. For a sweep between key frames this contains the ego motion.
    """

    path: Path
    ego_from_lidar: Pose

    def load(self) -> LidarScan:
        """Read the sweep. Points that are not finite (no return) are left out.

        One published file of Lyft ends within a point; what it has of that point is left out as well.

        Raises:
            ValueError: the file is missing, empty or truncated.
        """
        if not self.path.is_file():
            raise ValueError(f"{self.path}: the LiDAR file is missing")
        size = self.path.stat().st_size
        record = 4 * _FLOATS_PER_POINT
        if self.path.name == CUT_SHORT and size % record == 4 * _FLOATS_LEFT_OVER:
            size -= 4 * _FLOATS_LEFT_OVER
        if size == 0 or size % record:
            raise ValueError(
                f"{self.path}: the LiDAR file has {size} bytes, not a whole number of {record}-byte points "
                "(float32 x, y, z, intensity, ring): it is truncated or of another format; copy it again"
            )
        records = np.fromfile(self.path, dtype="<f4", count=size // 4).reshape(-1, _FLOATS_PER_POINT)
        points, intensity = records[:, :3].astype(np.float64), records[:, 3].astype(np.float64)
        if not np.isfinite(points).all():  # rare, and taking rows out is dear
            finite = np.isfinite(points).all(1)
            points, intensity = points[finite], intensity[finite]
        return LidarScan(self.ego_from_lidar.apply(points), intensity, self.ego_from_lidar.translation)
