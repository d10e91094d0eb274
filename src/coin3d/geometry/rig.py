"""A rig: the named cameras of one vehicle and the ground it stands on. The rig is data, never code."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float

from coin3d.geometry.camera import Camera
from coin3d.geometry.ground import GroundPlane
from coin3d.geometry.pose import Pose


@dataclass(frozen=True, eq=False)
class Rig(Mapping[str, Camera]):
    """An ordered mapping from camera name to ``Camera``: any number, order, size and lens.

    Args:
        cameras: name -> camera, poses in the ego frame (x forward, y left, z up).
        ground: the plane the vehicle stands on, in ego coordinates.
        ego_from_vehicle: where the user's own vehicle frame sits, if it is not the ego frame; results can be
            moved back with its inverse.
        name: for pictures and reports.

    Raises:
        ValueError: no cameras, or every camera below the ground.
    """

    cameras: Mapping[str, Camera]
    ground: GroundPlane = field(default_factory=GroundPlane)
    ego_from_vehicle: Pose = field(default_factory=Pose.identity)
    name: str = "rig"

    def __post_init__(self) -> None:
        cameras = dict(self.cameras)
        if not cameras:
            raise ValueError(f"rig '{self.name}' has no cameras")
        for name, camera in cameras.items():
            if self.ground.height_m(camera.ego_from_cam.translation) <= 0:
                raise ValueError(
                    f"camera '{name}' of rig '{self.name}' sits at or below the ground plane: positions are metres in the "
                    "ego frame with z up from the ground; if yours start at a sensor, set ego_from_vehicle"
                    + _hint_if_inverted(camera.ego_from_cam, self.ground)
                )
        object.__setattr__(self, "cameras", cameras)

    def __getitem__(self, name: str) -> Camera:
        try:
            return self.cameras[name]
        except KeyError:
            raise KeyError(f"rig '{self.name}' has no camera '{name}', only {list(self.cameras)}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self.cameras)

    def __len__(self) -> int:
        return len(self.cameras)

    def with_cameras(self, cameras: Mapping[str, Camera]) -> Rig:
        """The same rig with other cameras."""
        return replace(self, cameras=cameras)

    def sees(self, points_ego: Float[np.ndarray, "... 3"]) -> Bool[np.ndarray, "..."]:
        """Whether points project into at least one image."""
        seen = np.zeros(np.asarray(points_ego).shape[:-1], dtype=bool)
        for camera in self.values():
            seen |= camera.sees(points_ego)
        return seen


def is_plausible_mount(ego_from_cam: Pose, ground: GroundPlane) -> bool:
    """Whether a camera could be mounted so: 0.2 m to 5 m above ground, within 45 degrees of level, image bottom down."""
    up = ground.normal
    height_m = ground.height_m(ego_from_cam.translation)
    level = abs(ego_from_cam.rotation[:, 2] @ up) < np.sqrt(0.5)
    upright = -ego_from_cam.rotation[:, 1] @ up > np.sqrt(0.5)
    return bool(0.2 < height_m < 5.0 and level and upright)


def _hint_if_inverted(ego_from_cam: Pose, ground: GroundPlane) -> str:
    if not is_plausible_mount(ego_from_cam.inverse(), ground):
        return ""
    return ". The inverse of its pose would fit: cam_from_ego seems to be stored where ego_from_cam is expected; invert it"
