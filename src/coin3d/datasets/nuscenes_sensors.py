"""Which sensors a nuScenes-format recording has, and which of them a frame is made of."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path

_CAMERA_ORDER = ("CAM_FRONT", "CAM_FRONT_LEFT", "CAM_FRONT_RIGHT", "CAM_BACK", "CAM_BACK_LEFT", "CAM_BACK_RIGHT")


@dataclass(frozen=True)
class Sensors:
    """The channels of a recording.

    Args:
        path: the table they come from, for errors.
        cameras: channels of cameras.
        lidars: channels of LiDARs.
    """

    path: Path
    cameras: frozenset[str]
    lidars: frozenset[str]

    def cameras_in_order(self, channels: Iterable[str]) -> list[str]:
        """Camera channels: nuScenes' six first, in their usual order, then others by name."""
        cameras = self.cameras & set(channels)
        return [c for c in _CAMERA_ORDER if c in cameras] + sorted(cameras - set(_CAMERA_ORDER))

    def camera_channels(self, wanted: Collection[str] | None, leave_out: Collection[str]) -> set[str]:
        """The channels to read: what is wanted, or all cameras there are without those to leave out.

        Raises:
            ValueError: a wanted camera that the recording does not know.
        """
        if wanted is None:
            return set(self.cameras) - set(leave_out)
        if missing := sorted(set(wanted) - self.cameras):
            raise ValueError(f"{self.path}: no camera {', '.join(missing)}, only {', '.join(sorted(self.cameras))}")
        return set(wanted)

    def lidar_of(self, channels: Iterable[str]) -> str | None:
        """LIDAR_TOP, else the first other LiDAR by name, else nothing."""
        lidars = sorted(self.lidars & set(channels))
        return "LIDAR_TOP" if "LIDAR_TOP" in lidars else next(iter(lidars), None)
