"""A short drive with Waymo's five cameras and two of its lasers, as Frames whose every number is known.

The vehicle drives 1 m per frame and turns a little; it leans. Cameras fire at other moments than the frame's, so their poses
contain the drive in between. Range images are of flat ground at world z = -160 m, and what they stand for is computed here
pixel by pixel from the format's description. Cars and pedestrians stand around; one frame has nobody.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from coin3d.datasets.frame import Frame, LidarScan
from coin3d.geometry import Boxes3D, BrownConrady, Camera, Pose, Rig, preset_rig

CAMERA_NUMBERS = {"FRONT": 1, "FRONT_LEFT": 2, "FRONT_RIGHT": 3, "SIDE_LEFT": 4, "SIDE_RIGHT": 5}
LASER_NUMBERS = {"TOP": 1, "FRONT": 2, "SIDE_LEFT": 3, "SIDE_RIGHT": 4, "REAR": 5}
LABEL_NUMBERS = {"UNKNOWN": 0, "VEHICLE": 1, "PEDESTRIAN": 2, "SIGN": 3, "CYCLIST": 4}
START_US = 1_553_735_853_462_203
GROUND_M = -160.0
WIDTH_PX = 96
DISTORTION = [0.05, -0.3, 1e-3, -2e-3, 0.01]

# what of Waymo's axes of a camera (x forward, y left, z up) points along x right, y down, z forward
AXES = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


@dataclass
class Sweep:
    """Range images of one laser for one frame: two returns (h, w, 4) and, of the top one, the pixels' poses (h, w, 6)."""

    returns: tuple[np.ndarray, np.ndarray]
    poses: np.ndarray | None


@dataclass
class Laser:
    """A laser: mounting, inclinations from the lowest (or only their range)."""

    vehicle_from_laser: Pose
    low_rad: float
    high_rad: float
    inclinations_rad: list[float]


@dataclass(frozen=True)
class Codec:
    """How images are stored."""

    suffix: str
    options: tuple[int, ...] = ()

    def encode(self, image: np.ndarray) -> bytes:
        return bytes(cv2.imencode(self.suffix, cv2.cvtColor(image, cv2.COLOR_RGB2BGR), self.options)[1])

    def write(self, path: Path, image: np.ndarray) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(self.encode(image))


PNG = Codec(".png")
"""Without loss, so that pixels can be compared."""

JPEG = Codec(".jpg", (cv2.IMWRITE_JPEG_QUALITY, 95))


@dataclass
class Drive:
    """One segment: the frames, and what the files need to say it.

    Args:
        segment: its name.
        frames: as a reader should give them, sweeps of the first return.
        mounts: cameras as calibrated.
        distortion: k1, k2, p1, p2, k3 of all cameras.
        image_poses: per frame, camera name -> world from vehicle when it fired.
        lasers: laser name -> laser.
        sweeps: per frame, laser name -> range images.
        both: per frame, points of both returns, laser by laser.
        codec: of images, in formats that leave the choice.
    """

    segment: str
    frames: list[Frame]
    mounts: dict[str, Camera]
    distortion: list[float]
    image_poses: list[dict[str, Pose]]
    lasers: dict[str, Laser]
    sweeps: list[dict[str, Sweep]]
    both: list[np.ndarray] = field(default_factory=list)
    codec: Codec = PNG


@dataclass(frozen=True)
class Sweeping:
    """Points in memory."""

    points_ego: np.ndarray
    intensity: np.ndarray
    origin_ego: np.ndarray

    def load(self) -> LidarScan:
        return LidarScan(self.points_ego, self.intensity, self.origin_ego)


def vehicle_pose(metres: float) -> Pose:
    """Of the vehicle after so much of the drive."""
    place = (-25211.25 + metres * math.cos(0.4), 42391.5 + metres * math.sin(0.4), GROUND_M)
    return Pose.from_euler(0.4 + 0.02 * metres, 0.011, -0.007, place)


@cache
def make_drive(segment: str = "1024360_3580_000_3600_000", frames: int = 3, lidar: bool = True, blank: bool = False) -> Drive:
    """The drive; with ``blank`` images that hardly take room."""
    rng = np.random.default_rng(0)
    lens = BrownConrady(*DISTORTION)
    mounts = {name: replace(camera, lens=lens) for name, camera in preset_rig("waymo", WIDTH_PX).items()}
    lasers = {
        "TOP": Laser(
            Pose.from_euler(2.6, 0.01, 0.002, (1.43, 0.0, 2.18)), -0.3, 0.04, [-0.30, -0.21, -0.13, -0.07, -0.02, 0.04]
        ),
        "REAR": Laser(Pose.from_euler(math.pi, 0.0, 0.0, (-1.0, 0.1, 0.9)), -0.9, 0.2, []),
    }
    drive = Drive(segment, [], mounts, DISTORTION, [], lasers if lidar else {}, [])
    tokens = ["", *(f"{segment}-{START_US + 100_000 * k}" for k in range(frames)), ""]
    for k in range(frames):
        pose = vehicle_pose(k)
        at_image = {name: vehicle_pose(k + 0.05 * (i - 2)) for i, name in enumerate(mounts)}
        cameras = {n: c.moved(pose.inverse() @ at_image[n] @ c.ego_from_cam) for n, c in mounts.items()}
        sweeps = {name: _sweep(laser, name == "TOP", pose, k) for name, laser in drive.lasers.items()}
        first, both = sweep_points(drive.lasers, sweeps, pose, 1), sweep_points(drive.lasers, sweeps, pose, 2)
        drive.image_poses.append(at_image)
        drive.sweeps.append(sweeps)
        drive.both.append(both[:, :3])
        drive.frames.append(
            Frame(
                token=tokens[k + 1],
                timestamp_ns=(START_US + 100_000 * k) * 1000,
                rig=Rig(cameras, name=segment),
                images={
                    n: rng.integers(0, 1 if blank else 256, (c.height_px, WIDTH_PX, 3), np.uint8) for n, c in mounts.items()
                },
                world_from_ego=pose,
                boxes_world=_boxes(rng, 0 if k == 1 else 7, pose),
                lidar=Sweeping(first[:, :3], first[:, 3], lasers["TOP"].vehicle_from_laser.translation) if lidar else None,
                scene=segment,
                previous=tokens[k],
                next=tokens[k + 2],
            )
        )
    return drive


def boxes_vehicle(frame: Frame) -> Boxes3D:
    """Labels as the files hold them."""
    assert frame.boxes is not None
    return frame.boxes


def _boxes(rng: np.random.Generator, count: int, pose: Pose) -> Boxes3D:
    labels = [list(LABEL_NUMBERS)[i % 5] for i in range(count)]
    size = rng.uniform((3.5, 1.6, 1.4), (4.8, 2.0, 1.9), (count, 3))
    centre = np.column_stack([rng.uniform(-30, 30, (count, 2)), size[:, 2] / 2])
    boxes = Boxes3D.create(
        centre,
        size,
        rng.uniform(-3.1, 3.1, count),
        labels,
        velocity_mps=rng.uniform(-9, 9, (count, 2)),
        instance_ids=[f"object-{i}" for i in range(count)],
        num_lidar_points=rng.integers(0, 5000, count),
    )
    return boxes.transformed(pose)


def _sweep(laser: Laser, has_poses: bool, pose: Pose, k: int) -> Sweep:
    """Rays onto the ground. The vehicle goes on while the top laser turns: column by column."""
    height, width = (6, 24) if has_poses else (4, 10)
    returns = np.full((2, height, width, 4), -1.0, dtype=np.float32)
    poses = np.zeros((height, width, 6), dtype=np.float32) if has_poses else None
    for i in range(height):
        for j in range(width):
            then = pose
            if poses is not None:
                moment = vehicle_pose(k + 0.1 * (j / width - 0.5))
                yaw, pitch, roll = euler_rad(moment.rotation)
                poses[i, j] = (roll, pitch, yaw, *moment.translation)
                then = pixel_pose(poses[i, j])
            world_from_laser = then.matrix @ laser.vehicle_from_laser.matrix
            ray = world_from_laser[:3, :3] @ pixel_direction(laser, i, j, height, width)
            down = (GROUND_M - world_from_laser[2, 3]) / ray[2]
            if 0 < down < 60:
                returns[0, i, j] = (down, 0.25 + i, 0.1, -1)
                if (i + j) % 3 == 0:
                    returns[1, i, j] = (down * 0.75, 0.5 + j, 0.1, -1)
    return Sweep((returns[0], returns[1]), poses)


def sweep_points(lasers: dict[str, Laser], sweeps: dict[str, Sweep], pose: Pose, returns: int) -> np.ndarray:
    """(N, 4) position in the ego frame and intensity of every pixel with a return, one by one."""
    found = []
    for name, sweep in sweeps.items():
        for image in sweep.returns[:returns]:
            height, width = image.shape[:2]
            for i in range(height):
                for j in range(width):
                    if image[i, j, 0] > 0:
                        local = float(image[i, j, 0]) * pixel_direction(lasers[name], i, j, height, width)
                        point = lasers[name].vehicle_from_laser.matrix @ np.append(local, 1.0)
                        if sweep.poses is not None:
                            point = np.linalg.inv(pose.matrix) @ (pixel_pose(sweep.poses[i, j]).matrix @ point)
                        found.append([*point[:3], float(image[i, j, 1])])
    return np.array(found).reshape(-1, 4)


def pixel_direction(laser: Laser, i: int, j: int, height: int, width: int) -> np.ndarray:
    """Row 0 looks highest although inclinations are stored from the lowest; column 0 looks back, columns turn right."""
    upwards = height - 1 - i
    if laser.inclinations_rad:
        inclination = laser.inclinations_rad[upwards]
    else:
        inclination = laser.low_rad + (upwards + 0.5) / height * (laser.high_rad - laser.low_rad)
    mounted = laser.vehicle_from_laser.rotation
    azimuth = ((width - j - 0.5) / width * 2 - 1) * math.pi - math.atan2(mounted[1, 0], mounted[0, 0])
    flat = math.cos(inclination)
    return np.array([flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(inclination)])


def pixel_pose(numbers: np.ndarray) -> Pose:
    roll, pitch, yaw, x, y, z = (float(n) for n in numbers)
    cr, sr, cp, sp, cy, sy = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch), math.cos(yaw), math.sin(yaw)
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return Pose(about_z @ about_y @ about_x, np.array([x, y, z]))


def euler_rad(rotation: np.ndarray) -> tuple[float, float, float]:
    """Yaw, pitch, roll."""
    r = rotation
    return math.atan2(r[1, 0], r[0, 0]), -math.asin(r[2, 0]), math.atan2(r[2, 1], r[2, 2])
