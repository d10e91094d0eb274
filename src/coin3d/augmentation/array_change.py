"""Changes of the camera array itself: cameras dropped, added, or laid out anew all around. Beyond the paper."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from coin3d.geometry import Camera, GroundPlane, Pose, Rig, camera_pose

KEPT, DROPPED, ADDED, RING = range(4)


@dataclass(frozen=True)
class ArrayChange:
    """Draws another set of cameras for the same vehicle.

    Four things can happen, each with its weight; what the rig does not allow (dropping the only camera, adding to a full
    rig) is left out of the lottery.

    Args:
        keep: weight of leaving the array as it is.
        drop: weight of keeping a random part of the cameras, at least one.
        add: weight of adding cameras: copies of random ones, turned to any direction, on the circle the cameras sit on.
        ring: weight of laying the array out anew: equal cameras at equal angles that overlap all around.
        max_cameras: cameras after adding or in a ring, at most.
        ring_overlap: field of view of a ring camera beyond its share of the circle, as a part of that share; 1 sees
            everything twice (six cameras of 120 degrees).
        ring_max_fov_deg: widest field of view in a ring, which sets how few cameras can make one.
    """

    keep: float = 1.0
    drop: float = 1.0
    add: float = 1.0
    ring: float = 1.0
    max_cameras: int = 8
    ring_overlap: tuple[float, float] = (0.1, 1.0)
    ring_max_fov_deg: float = 120.0

    def __post_init__(self) -> None:
        weights = (self.keep, self.drop, self.add, self.ring)
        if min(weights) < 0 or self.keep <= 0:
            raise ValueError(f"weights of array changes are not negative and that of keeping is positive, got {weights}")
        if self.max_cameras < 1:
            raise ValueError(f"max_cameras is at least 1, got {self.max_cameras}")
        if not 0 < self.ring_overlap[0] <= self.ring_overlap[1] or not 0 < self.ring_max_fov_deg < 170:
            raise ValueError(f"ring_overlap is 0 < low <= high and ring_max_fov_deg below 170, got {self}")

    @property
    def fewest_in_ring(self) -> int:
        """How many cameras a ring needs for the smallest overlap at the widest field of view."""
        return int(np.ceil(360 * (1 + self.ring_overlap[0]) / self.ring_max_fov_deg - 1e-9))

    def draw(self, rig: Rig, rng: np.random.Generator) -> tuple[Rig, bool]:
        """The changed rig, and whether it was laid out anew."""
        weights = np.array([self.keep, self.drop, self.add, self.ring])
        weights *= [True, len(rig) > 1, len(rig) < self.max_cameras, self.max_cameras >= self.fewest_in_ring]
        change = int(rng.choice(4, p=weights / weights.sum()))
        if change == DROPPED:
            return _part(rig, rng), False
        if change == ADDED:
            return self._extended(rig, rng), False
        return (self._ring(rig, rng), True) if change == RING else (rig, False)

    def _extended(self, rig: Rig, rng: np.random.Generator) -> Rig:
        cameras, donors = dict(rig), list(rig.values())
        centre, radius_m = _circle(donors)
        for i in range(int(rng.integers(1, self.max_cameras - len(rig) + 1))):
            donor, yaw_rad = donors[rng.integers(len(donors))], rng.uniform(-np.pi, np.pi)
            pose = turned(donor.ego_from_cam, yaw_rad - donor.yaw_rad, rig.ground)
            place = _on_circle(centre, radius_m, yaw_rad, float(donor.ego_from_cam.translation[2]))
            cameras[f"added{i}"] = donor.moved(replace(pose, translation=place))
        return rig.with_cameras(cameras)

    def _ring(self, rig: Rig, rng: np.random.Generator) -> Rig:
        donors = list(rig.values())
        donor = donors[rng.integers(len(donors))]
        centre, radius_m = _circle(donors)
        count = int(rng.integers(self.fewest_in_ring, self.max_cameras + 1))
        share_deg = 360 / count
        fov_deg = min(share_deg * (1 + rng.uniform(*self.ring_overlap)), self.ring_max_fov_deg)
        width, height = donor.width_px, donor.height_px
        focal_px = width / 2 / np.tan(np.deg2rad(fov_deg) / 2)
        K = np.array([[focal_px, 0, width / 2], [0, focal_px, height / 2], [0, 0, 1]])
        first_deg = rng.uniform(0, 360)
        cameras = {}
        for i in range(count):
            yaw_rad = np.deg2rad(first_deg + i * share_deg)
            place = _on_circle(centre, radius_m, yaw_rad, float(centre[2]))
            cameras[f"ring{i}"] = Camera(K, width, height, camera_pose(place, yaw_rad))
        return rig.with_cameras(cameras)


def turned(ego_from_cam: Pose, angle_rad: float, ground: GroundPlane) -> Pose:
    """A camera turned on the spot about the upright of the ground, to the left for positive angles."""
    turn = Rotation.from_rotvec(angle_rad * ground.normal).as_matrix()
    return Pose(turn @ ego_from_cam.rotation, ego_from_cam.translation)


def _part(rig: Rig, rng: np.random.Generator) -> Rig:
    names = list(rig)
    kept = sorted(rng.choice(len(names), int(rng.integers(1, len(names))), replace=False))
    return rig.with_cameras({names[i]: rig[names[i]] for i in kept})


def _circle(cameras: list[Camera]) -> tuple[Float[np.ndarray, "3"], float]:
    """Centre of the cameras' places and their mean distance from it, seen from above."""
    places = np.stack([camera.ego_from_cam.translation for camera in cameras])
    centre = places.mean(0)
    return centre, float(np.linalg.norm((places - centre)[:, :2], axis=1).mean())


def _on_circle(centre: Float[np.ndarray, "3"], radius_m: float, yaw_rad: float, z_m: float) -> Float[np.ndarray, "3"]:
    return np.array([centre[0] + radius_m * np.cos(yaw_rad), centre[1] + radius_m * np.sin(yaw_rad), z_m])
