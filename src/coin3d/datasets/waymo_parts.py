"""What the two formats of the Waymo Open Dataset have in common: names, calibrations, and how a ``Frame`` is put together."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from coin3d.datasets.frame import Frame
from coin3d.datasets.image_source import ImageSource
from coin3d.datasets.own_vehicle import own_vehicle_masks
from coin3d.datasets.waymo_range_image import LaserCalibration, LaserImagesSource, WaymoLidar
from coin3d.geometry import Boxes3D, BrownConrady, Camera, Lens, Pinhole, Pose, Rig, camera_pose

CAMERA_NAMES = {1: "FRONT", 2: "FRONT_LEFT", 3: "FRONT_RIGHT", 4: "SIDE_LEFT", 5: "SIDE_RIGHT"}
"""Number in the files -> name; frames have their cameras in this order, which is that of the rig preset ``waymo``."""

LASER_NAMES = {1: "TOP", 2: "FRONT", 3: "SIDE_LEFT", 4: "SIDE_RIGHT", 5: "REAR"}
LABEL_NAMES = {0: "UNKNOWN", 1: "VEHICLE", 2: "PEDESTRIAN", 3: "SIGN", 4: "CYCLIST"}

# Waymo's camera frame is x forward, y left, z up
_WAYMO_CAM_FROM_CAM = camera_pose([0.0, 0.0, 0.0])
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,199}")


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """A camera as calibrated.

    Args:
        intrinsic: (9,) f_u, f_v, c_u, c_v in pixels from the left and upper edge of the image, then k1, k2, p1, p2, k3.
        vehicle_from_cam: its mounting, in Waymo's axes of a camera.
        width_px: image width.
        height_px: image height.
    """

    intrinsic: Float[np.ndarray, "9"]
    vehicle_from_cam: Pose
    width_px: int
    height_px: int

    def camera(self, ego_from_vehicle: Pose) -> Camera:
        """The camera in the ego frame of a frame.

        Args:
            ego_from_vehicle: the drive between the frame's instant and the image's.

        Raises:
            ValueError: intrinsics that make no sense.
        """
        f_u, f_v, c_u, c_v = self.intrinsic[:4]
        # Waymo counts pixels from the edge of the first one, as Camera does
        K = np.array([[f_u, 0.0, c_u], [0.0, f_v, c_v], [0.0, 0.0, 1.0]])
        ego_from_cam = ego_from_vehicle @ self.vehicle_from_cam @ _WAYMO_CAM_FROM_CAM
        return Camera(K, self.width_px, self.height_px, ego_from_cam, _lens(self.intrinsic[4:]))


@dataclass(frozen=True, eq=False)
class WaymoImage:
    """One image.

    Args:
        source: its pixels.
        world_from_vehicle: pose of the vehicle when the image was taken.
    """

    source: ImageSource
    world_from_vehicle: Pose


@dataclass(frozen=True, eq=False)
class WaymoLabels:
    """The boxes of one frame.

    Args:
        boxes_vehicle: in the vehicle frame, where they stand upright.
        velocity_world_mps: (N, 2) in the world frame, as Waymo gives it; NaN where unknown.
    """

    boxes_vehicle: Boxes3D
    velocity_world_mps: Float[np.ndarray, "n 2"]

    def boxes_world(self, world_from_vehicle: Pose) -> Boxes3D:
        """The boxes in the world frame."""
        moved = self.boxes_vehicle.transformed(world_from_vehicle)
        return replace(moved, velocity_mps=np.asarray(self.velocity_world_mps, dtype=np.float64))


@dataclass(frozen=True, eq=False)
class WaymoInstant:
    """One frame of a segment, as either format gives it.

    Args:
        segment: name of the sequence.
        timestamp_us: start of the frame, by which Waymo names it.
        world_from_vehicle: pose of the vehicle in whose frame labels are given.
        calibrations: camera number -> calibration.
        images: camera number -> image.
        labels: its boxes, None in a segment without annotations.
        lasers: laser name -> calibration.
        range_images: of the lasers, if recorded.
        where: names file and frame in errors.
    """

    segment: str
    timestamp_us: int
    world_from_vehicle: Pose
    calibrations: Mapping[int, CameraCalibration]
    images: Mapping[int, WaymoImage]
    labels: WaymoLabels | None
    lasers: Mapping[str, LaserCalibration]
    range_images: LaserImagesSource | None
    where: str

    def frame(self, previous: str, following: str, root: Path, second_return: bool) -> Frame:
        """The frame.

        Args:
            previous: token of the frame before.
            following: token of the frame after.
            root: folder of the recording.
            second_return: whether the sweep holds the second returns as well.

        Raises:
            ValueError: an image without calibration, no images, or a calibration that makes no sense.
        """
        try:
            return self._frame(previous, following, root, second_return)
        except ValueError as error:
            raise ValueError(f"{self.where}: {error}") from error

    def _frame(self, previous: str, following: str, root: Path, second_return: bool) -> Frame:
        numbers = [n for n in CAMERA_NAMES if n in self.images]
        if not numbers:
            raise ValueError("the frame has no images")
        lidar = None
        if self.range_images is not None:
            lidar = WaymoLidar(self.range_images, self.lasers, self.world_from_vehicle, second_return, self.where)
        return Frame(
            token=token(self.segment, self.timestamp_us),
            timestamp_ns=self.timestamp_us * 1000,
            rig=self._rig(numbers),
            images={CAMERA_NAMES[n]: self.images[n].source for n in numbers},
            world_from_ego=self.world_from_vehicle,
            boxes_world=None if self.labels is None else self.labels.boxes_world(self.world_from_vehicle),
            lidar=lidar,
            scene=self.segment,
            previous=previous,
            next=following,
            own_vehicle=own_vehicle_masks(root, (CAMERA_NAMES[n] for n in numbers)),
        )

    def _rig(self, numbers: list[int]) -> Rig:
        ego_from_world = self.world_from_vehicle.inverse()
        cameras = {}
        for n in numbers:
            if n not in self.calibrations:
                raise ValueError(f"camera {CAMERA_NAMES[n]} has an image but no calibration")
            try:
                cameras[CAMERA_NAMES[n]] = self.calibrations[n].camera(ego_from_world @ self.images[n].world_from_vehicle)
            except ValueError as error:
                raise ValueError(f"camera {CAMERA_NAMES[n]}: {error}") from error
        return Rig(cameras, name=self.segment)


def token(segment: str, timestamp_us: int) -> str:
    """Name of a frame, unique in the data set and fit for the name of a file."""
    return f"{segment}-{timestamp_us}"


def checked_segment(name: str | None, where: str) -> str:
    """A segment's name, which becomes the name of folders.

    Raises:
        ValueError: none, or one that could lead elsewhere.
    """
    if name is None or not _NAME.fullmatch(name):
        raise ValueError(f"{where}: '{name}' is no name of a segment (letters, digits, '_', '-', '.'); the file is damaged")
    return name


def checked_timestamp(microseconds: int | None, where: str) -> int:
    """A time in microseconds since 1970 that fits 64 bits of nanoseconds; raises ValueError for any other."""
    if microseconds is None or not 0 < microseconds < 2**63 // 1000:
        raise ValueError(f"{where}: {microseconds} is no time in microseconds since 1970; the file is damaged")
    return int(microseconds)


def pose_of(transform: Float[np.ndarray, "n"], where: str) -> Pose:
    """A pose from the 16 numbers of a matrix, row by row; raises ValueError naming ``where``."""
    if transform.shape != (16,):
        raise ValueError(f"{where}: a transform has 16 numbers, got {transform.size}")
    try:
        return Pose.from_matrix(transform.reshape(4, 4))
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error


def number_of(value: int | None, names: Mapping[int, str], where: str) -> int:
    """A number that has a name; raises ValueError for any other."""
    if value is None or int(value) not in names:
        raise ValueError(f"{where}: {value} is none of {', '.join(f'{n} {name}' for n, name in names.items())}")
    return int(value)


def _lens(coefficients: Float[np.ndarray, "5"]) -> Lens:
    """The lens of k1, k2, p1, p2, k3; a pinhole where all are zero."""
    if not coefficients.any():
        return Pinhole()
    k1, k2, p1, p2, k3 = coefficients.tolist()
    return BrownConrady(k1=k1, k2=k2, p1=p1, p2=p2, k3=k3)
