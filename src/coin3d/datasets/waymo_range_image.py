"""Range images of Waymo's LiDARs and the points they stand for. All in double precision: world coordinates are large."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from coin3d.datasets.frame import LidarScan
from coin3d.geometry import Pose

TOP = "TOP"
"""The long-range laser on the roof, the only one whose pixels have poses of their own."""


@dataclass(frozen=True, eq=False)
class LaserCalibration:
    """Where a laser sits and how its rows are inclined.

    Args:
        vehicle_from_laser: its mounting.
        lowest_rad: lower edge of the field of view.
        highest_rad: upper edge.
        inclinations_rad: one per row, from the lowest to the highest; empty where rows are evenly spaced between the edges.
    """

    vehicle_from_laser: Pose
    lowest_rad: float
    highest_rad: float
    inclinations_rad: Float[np.ndarray, "h"]

    def __post_init__(self) -> None:
        if not np.isfinite([self.lowest_rad, self.highest_rad, *self.inclinations_rad]).all():
            raise ValueError("an inclination of a laser is not finite")

    def rows_rad(self, height: int) -> Float[np.ndarray, "h"]:
        """Inclination of every row of a range image: row 0 looks highest, so the stored order is reversed.

        Raises:
            ValueError: the calibration is of another number of rows.
        """
        if not len(self.inclinations_rad):
            steps = (np.arange(height) + 0.5) / height
            return np.asarray((self.lowest_rad + steps * (self.highest_rad - self.lowest_rad))[::-1])
        if len(self.inclinations_rad) != height:
            raise ValueError(f"a range image of {height} rows, but a calibration of {len(self.inclinations_rad)}")
        return np.asarray(self.inclinations_rad, dtype=np.float64)[::-1]

    def columns_rad(self, width: int) -> Float[np.ndarray, "w"]:
        """Azimuth of every column in the laser's frame: from pi down to -pi, less the heading of the laser's mounting."""
        heading = self.vehicle_from_laser.yaw_rad
        return np.asarray(((width - np.arange(width) - 0.5) / width * 2 - 1) * np.pi - heading)


@dataclass(frozen=True, eq=False)
class LaserImages:
    """What one laser saw in one turn.

    Args:
        returns: one range image per return of the light, rows x columns x channels: range in metres (0 or less where nothing
            came back), intensity, and more.
        pixel_poses: rows x columns x (roll, pitch, yaw, x, y, z), world from vehicle when each pixel was taken; None where
            the pixels are in the frame's own vehicle frame already.
    """

    returns: tuple[Float[np.ndarray, "h w c"], ...]
    pixel_poses: Float[np.ndarray, "h w 6"] | None = None


@runtime_checkable
class LaserImagesSource(Protocol):
    """Anything that can load the range images of a frame when asked for."""

    def load(self, second_return: bool) -> Mapping[str, LaserImages]:
        """Laser name -> its range images; raises ValueError where they are damaged."""
        ...


@dataclass(frozen=True, eq=False)
class WaymoLidar:
    """The lasers of one frame as a single sweep, read when asked for.

    Args:
        source: of the range images.
        calibrations: laser name -> calibration.
        world_from_ego: of the frame.
        second_return: whether to add the points of the light's second return.
        where: names the frame in errors.
    """

    source: LaserImagesSource
    calibrations: Mapping[str, LaserCalibration]
    world_from_ego: Pose
    second_return: bool
    where: str

    def load(self) -> LidarScan:
        """Points of all lasers. Rays are said to start at the top laser, or the first one where there is none.

        Raises:
            FileNotFoundError: the file is gone.
            ValueError: a range image is damaged, or contradicts the calibration.
        """
        points, intensity = [np.zeros((0, 3))], [np.zeros(0)]
        images = self.source.load(self.second_return)
        for name, laser in images.items():
            if name not in self.calibrations:
                raise ValueError(f"{self.where}: laser {name} has range images but no calibration")
            for image in laser.returns:
                try:
                    xyz = laser_points(image, self.calibrations[name], laser.pixel_poses, self.world_from_ego)
                except ValueError as error:
                    raise ValueError(f"{self.where}: laser {name}: {error}") from error
                points.append(xyz)
                intensity.append(image[..., 1][image[..., 0] > 0].astype(np.float64))
        first = TOP if TOP in images else next(iter(images), None)
        origin = np.zeros(3) if first is None else self.calibrations[first].vehicle_from_laser.translation
        return LidarScan(np.concatenate(points), np.concatenate(intensity), origin)


def laser_points(
    image: Float[np.ndarray, "h w c"],
    calibration: LaserCalibration,
    pixel_poses: Float[np.ndarray, "rows columns numbers"] | None,
    world_from_ego: Pose,
) -> Float[np.ndarray, "n 3"]:
    """Points of a range image in the ego frame, row by row, pixels without a return left out.

    Args:
        image: range in metres, intensity, and more.
        calibration: of the laser.
        pixel_poses: (h, w, 6) roll, pitch, yaw, x, y, z of the vehicle in the world at every pixel, None for lasers without.
        world_from_ego: pose of the frame.

    Raises:
        ValueError: a shape that is not that of the calibration or the poses, or a number that is not finite.
    """
    if image.ndim != 3 or image.shape[2] < 2:
        raise ValueError(f"a range image is rows x columns x (range, intensity, ...), got {image.shape}")
    height, width = image.shape[:2]
    if pixel_poses is not None and pixel_poses.shape != (height, width, 6):
        raise ValueError(f"pixel poses of shape {pixel_poses.shape} for a range image of {image.shape}")
    rows, columns = np.nonzero(image[..., 0] > 0)
    range_m = image[rows, columns, 0].astype(np.float64)
    if not np.isfinite(range_m).all():
        raise ValueError("a range is not finite; the range image is damaged")
    inclination = calibration.rows_rad(height)[rows]
    azimuth = calibration.columns_rad(width)[columns]
    flat_m = range_m * np.cos(inclination)
    in_laser = np.stack([flat_m * np.cos(azimuth), flat_m * np.sin(azimuth), range_m * np.sin(inclination)], axis=-1)
    points = calibration.vehicle_from_laser.apply(in_laser)
    if pixel_poses is not None and len(points):
        poses = pixel_poses[rows, columns].astype(np.float64)
        if not np.isfinite(poses).all():
            raise ValueError("the pose of a pixel is not finite; the range image is damaged")
        points = _into_one_instant(points, poses, world_from_ego)
    return points


def _into_one_instant(
    points_vehicle: Float[np.ndarray, "n 3"], poses: Float[np.ndarray, "n 6"], world_from_ego: Pose
) -> Float[np.ndarray, "n 3"]:
    """From the vehicle at each point's own time to the vehicle at the frame's time."""
    x, y, z = points_vehicle.T
    cos, sin = np.cos(poses[:, :3]).T, np.sin(poses[:, :3]).T
    # Rz(yaw) Ry(pitch) Rx(roll), one after the other: a rotation object for every point takes ten times as long
    y, z = cos[0] * y - sin[0] * z, sin[0] * y + cos[0] * z
    x, z = cos[1] * x + sin[1] * z, cos[1] * z - sin[1] * x
    x, y = cos[2] * x - sin[2] * y, sin[2] * x + cos[2] * y
    turned = np.stack([x, y, z], axis=-1)
    return np.asarray((turned + (poses[:, 3:] - world_from_ego.translation)) @ world_from_ego.rotation)
