"""The frame a calibration file starts from, and where the user says it sits on the vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from coin3d.geometry import Camera, Pose, camera_pose


@dataclass(frozen=True, eq=False)
class Imported:
    """What a reader found.

    Args:
        cameras: name -> camera whose ``ego_from_cam`` is base_from_cam.
        base: name of the base frame.
        base_is_camera: whether it is one of the cameras (x right, y down, z forward).
        base_pose_required: whether the base may sit anywhere on the vehicle.
        remarks: for the user.
    """

    cameras: Mapping[str, Camera]
    base: str
    base_is_camera: bool
    base_pose_required: bool
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Base:
    """What the user knows about the base frame.

    Args:
        name: of the frame; None leaves it to the format.
        pose: x, y, z in metres (forward, left, up from the ground under the rear axle), yaw, pitch, roll in degrees. Of a
            camera: as in rig.yaml, 0 0 0 looks forward. Of another frame: 0 0 0 has x forward, y left, z up.
        matrix: (4, 4) ego_from_base instead.

    Raises:
        ValueError: both a pose and a matrix, or numbers that are no pose.
    """

    name: str | None = None
    pose: tuple[float, float, float, float, float, float] | None = None
    matrix: Float[np.ndarray, "4 4"] | None = None

    def __post_init__(self) -> None:
        if self.pose is not None and self.matrix is not None:
            raise ValueError("say where the base is by --base-pose or by --base-matrix, not by both")
        if self.pose is not None and not np.isfinite(self.pose).all():
            raise ValueError(f"--base-pose holds a number that is not finite: {self.pose}")
        if self.matrix is not None:
            Pose.from_matrix(self.matrix)

    def ego_from_base(self, *, camera: bool, required: bool, name: str = "") -> Pose:
        """The pose of the base on the vehicle; the identity if the user gave none and need not.

        Raises:
            ValueError: required and missing.
        """
        if self.matrix is not None:
            return Pose.from_matrix(self.matrix)
        if self.pose is None:
            if required:
                looking = "the direction it looks in" if camera else "its axes' yaw, pitch and roll"
                raise ValueError(
                    f"the file does not say where '{name}' sits on the vehicle: add --base-pose X Y Z YAW PITCH ROLL, its "
                    f"position in metres (forward, left, up from the ground under the rear axle) and {looking} in degrees"
                )
            return Pose.identity()
        x, y, z, *degrees = self.pose
        yaw, pitch, roll = np.deg2rad(degrees).tolist()
        return camera_pose((x, y, z), yaw, pitch, roll) if camera else Pose.from_euler(yaw, pitch, roll, (x, y, z))
