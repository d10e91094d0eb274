"""Novel rigs drawn around a rig: the configurations that training frames are rendered through (paper supplement, CDA)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from coin3d.augmentation.array_change import ArrayChange, turned
from coin3d.augmentation.mount_ranges import MountRanges, Range, lyft_mounts, waymo_mounts
from coin3d.geometry import Camera, GroundPlane, Pose, Rig


@dataclass(frozen=True)
class RigSampler:
    """Ranges of a random rig. The defaults are the paper's; how they apply follows spec official_code 3.2.

    Every camera on its own: focal length, shift, height above the rig's ground, turn about the upright, principal point.
    Its roll and pitch stay. Then the whole rig leans by one roll and one pitch about the ego origin, which moves heights by
    a few centimetres more. Image sizes stay; drawn cameras are pinholes.

    Args:
        focal_ratio: factor on the focal length.
        shift_m: shift in x and y, within plus or minus this.
        height_m: height above the ground, absolute.
        yaw_deg: turn, within plus or minus this.
        tilt_deg: lean of the rig, roll and pitch, within plus or minus this.
        jitter_centre: draw the principal point anew, at most as far from the middle of the image as it is.
        mounts: target-aware ranges by camera, which take the place of ``focal_ratio``, ``shift_m`` and ``yaw_deg``. The
            rig must have exactly these cameras.
        array: also change which cameras there are; beyond the paper.

    Raises:
        ValueError: ranges that make no sense, or ``mounts`` together with ``array``.
    """

    focal_ratio: Range = (0.7, 1.4)
    shift_m: float = 0.2
    height_m: Range = (1.5, 2.2)
    yaw_deg: float = 20.0
    tilt_deg: float = 2.0
    jitter_centre: bool = True
    mounts: tuple[MountRanges, ...] = ()
    array: ArrayChange | None = None

    def __post_init__(self) -> None:
        if not 0 < self.focal_ratio[0] <= self.focal_ratio[1] or not 0 < self.height_m[0] <= self.height_m[1]:
            raise ValueError(f"focal_ratio and height_m are 0 < low <= high, got {self.focal_ratio} and {self.height_m}")
        if min(self.shift_m, self.yaw_deg, self.tilt_deg) < 0 or self.tilt_deg > 45:
            raise ValueError(f"shift_m, yaw_deg and tilt_deg are not negative (tilt at most 45), got {self}")
        if self.mounts and self.array is not None:
            raise ValueError("target-aware ranges are those of one array of cameras: they cannot be used with array changes")

    @classmethod
    def target_aware_lyft(cls) -> RigSampler:
        """Lyft as the source, nuScenes as the known target (spec official_code 3.3)."""
        return cls(height_m=(1.5, 1.8), mounts=lyft_mounts())

    @classmethod
    def target_aware_waymo(cls) -> RigSampler:
        """Waymo as the source, nuScenes as the known target (spec official_code 3.3, its sign slip corrected)."""
        return cls(height_m=(1.5, 2.1), mounts=waymo_mounts())

    def draw(self, rig: Rig, rng: np.random.Generator) -> Rig:
        """A novel rig; a function of the rig and the generator's state alone.

        Raises:
            ValueError: target-aware ranges for other cameras than the rig's.
        """
        by_name = {m.camera: m for m in self.mounts}
        if self.mounts and set(by_name) != set(rig):
            raise ValueError(
                f"these target-aware ranges are for the cameras {', '.join(by_name)}, but the rig '{rig.name}' has "
                f"{', '.join(rig)}; use the generic ranges"
            )
        laid_out_anew = False
        if self.array is not None:
            rig, laid_out_anew = self.array.draw(rig, rng)
        # a ring keeps its angles and field of view, or it would have gaps
        generic = replace(self, focal_ratio=(1.0, 1.0), yaw_deg=0.0) if laid_out_anew else self
        lean = _lean(self.tilt_deg, rng)
        cameras = {}
        for name, camera in rig.items():
            drawn = (
                self._mounted(camera, by_name[name], rig.ground, rng) if self.mounts else generic._near(camera, rig.ground, rng)
            )
            cameras[name] = drawn.moved(lean @ drawn.ego_from_cam)
        return rig.with_cameras(cameras)

    def _near(self, camera: Camera, ground: GroundPlane, rng: np.random.Generator) -> Camera:
        ratio = rng.uniform(*self.focal_ratio)
        angle_rad = np.deg2rad(rng.uniform(-self.yaw_deg, self.yaw_deg))
        shift_m = rng.uniform(-self.shift_m, self.shift_m, 2)
        place = camera.ego_from_cam.translation + np.array([*shift_m, 0.0])
        pose = self._placed(turned(camera.ego_from_cam, angle_rad, ground), place, ground, rng)
        return _pinhole(camera, ratio, self._centre(camera, rng), pose)

    def _mounted(self, camera: Camera, ranges: MountRanges, ground: GroundPlane, rng: np.random.Generator) -> Camera:
        weights = np.array([weight for weight, _, _ in ranges.focal_px])
        _, low, high = ranges.focal_px[int(rng.choice(len(weights), p=weights / weights.sum()))]
        ratio = rng.uniform(low, high) * ranges.scale(camera) / camera.focal_px
        yaw_rad = camera.yaw_rad if ranges.yaw_deg is None else np.deg2rad(rng.uniform(*ranges.yaw_deg))
        place = camera.ego_from_cam.translation.copy()
        for axis, span in enumerate((ranges.x_m, ranges.y_m)):
            place[axis] = place[axis] if span is None else rng.uniform(*span)
        pose = self._placed(turned(camera.ego_from_cam, yaw_rad - camera.yaw_rad, ground), place, ground, rng)
        centre = self._centre(camera, rng)
        if ranges.centre_v_px is not None:
            centre[1] = rng.uniform(*ranges.centre_v_px) * ranges.scale(camera)
        return _pinhole(camera, ratio, centre, pose)

    def _placed(self, pose: Pose, place: Float[np.ndarray, "3"], ground: GroundPlane, rng: np.random.Generator) -> Pose:
        """At a place, moved along the upright to a random height above the ground."""
        rise_m = rng.uniform(*self.height_m) - float(ground.height_m(place))
        return replace(pose, translation=place + rise_m * ground.normal)

    def _centre(self, camera: Camera, rng: np.random.Generator) -> Float[np.ndarray, "2"]:
        middle = np.array([camera.width_px, camera.height_px]) / 2
        now = np.array(camera.K[:2, 2])
        return middle + rng.uniform(-1, 1, 2) * np.abs(now - middle) if self.jitter_centre else now


def _lean(tilt_deg: float, rng: np.random.Generator) -> Pose:
    roll_rad, pitch_rad = np.deg2rad(rng.uniform(-tilt_deg, tilt_deg, 2))
    return Pose.from_euler(0.0, float(pitch_rad), float(roll_rad), np.zeros(3))


def _pinhole(camera: Camera, focal_ratio: float, centre: Float[np.ndarray, "2"], ego_from_cam: Pose) -> Camera:
    K = np.array(camera.K)
    K[:2, :2] *= focal_ratio
    K[:2, 2] = centre
    return Camera(K, camera.width_px, camera.height_px, ego_from_cam)
