"""Two short drives through a town, as Frames whose every number is known: what each format is written from.

A rig of five cameras drives through the embedded town on hilly ground. The first drive has three frames, the second two, with
images of another size. LiDAR points are put onto the grid of a spinning laser, the only thing a range image can say; boxes,
poses of the vehicle and pictures are those of the town. The vehicle is said to drive on while one camera fires after the other.
Velocities are those that the annotations of a drive tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from coin3d.datasets.frame import Frame
from coin3d.datasets.open import open_recording
from coin3d.geometry import Boxes3D, Camera, Pose, Rig, preset_rig
from coin3d.town import TownOptions, record
from waymo_drive import Drive, Laser, Sweep, Sweeping, euler_rad, pixel_pose, sweep_points

FRAMES_PER_DRIVE = {"town-a": 3, "town-b": 2}
WIDTH_PX = 64
ROWS_CUT = 6
"""Rows that the images of the second drive lack at the top."""
ROOF = Laser(
    Pose.from_euler(2.6, 0.01, 0.002, (1.43, 0.0, 2.18)), -0.55, 0.08, (np.linspace(-0.74, 0.28, 20) ** 3 + 0.02).tolist()
)
COLUMNS = 120


def make_town_drives(folder: Path) -> list[Drive]:
    """The drives; the town is recorded into a folder first."""
    mounts = dict(preset_rig("waymo", WIDTH_PX))
    options = TownOptions(slope=True, traffic=0.3, people=0.3)
    frames_in_all = sum(FRAMES_PER_DRIVE.values())
    record(preset_rig("waymo", WIDTH_PX), folder, [2], key_frames=frames_in_all, options=options, progress=lambda line: None)
    town = list(open_recording(folder))
    drives, first = [], 0
    for number, (name, count) in enumerate(FRAMES_PER_DRIVE.items()):
        drives.append(_drive(name, town[first : first + count], mounts, ROWS_CUT * number))
        first += count
    return drives


def relabelled(drive: Drive, names: dict[str, str]) -> Drive:
    """The drive with the class names of another data set."""
    frames = [f.with_boxes_world(_boxes(f).with_labels([names[label] for label in _boxes(f).labels])) for f in drive.frames]
    return replace(drive, frames=frames)


def _drive(name: str, town: Sequence[Frame], mounts: dict[str, Camera], rows_cut: int) -> Drive:
    cut = np.array([[1.0, 0, 0], [0, 1, -rows_cut], [0, 0, 1]])
    cameras = {n: c.transformed(cut, c.width_px, c.height_px - rows_cut) for n, c in mounts.items()}
    drive = Drive(name, [], cameras, [0.0] * 5, [], {"TOP": ROOF}, [])
    tokens = ["", *(f"{name}-{frame.timestamp_ns // 1000}" for frame in town), ""]
    tables = _with_velocities([_boxes(frame) for frame in town], [frame.timestamp_ns * 1e-9 for frame in town])
    for k, frame in enumerate(town):
        pose = frame.world_from_ego
        when_taken = {n: pose @ _drive_on(0.02 * (i - 2)) for i, n in enumerate(mounts)}
        moved = {n: c.moved(pose.inverse() @ when_taken[n] @ c.ego_from_cam) for n, c in cameras.items()}
        assert frame.lidar is not None
        scan = frame.lidar.load()
        sweep = _sweep(scan.points_ego, scan.intensity, pose)
        points = sweep_points(drive.lasers, {"TOP": sweep}, pose, 1)
        drive.image_poses.append(when_taken)
        drive.sweeps.append({"TOP": sweep})
        drive.frames.append(
            Frame(
                token=tokens[k + 1],
                timestamp_ns=frame.timestamp_ns,
                rig=Rig(moved, name=name),
                images={n: np.ascontiguousarray(frame.image(n)[rows_cut:]) for n in mounts},
                world_from_ego=pose,
                boxes_world=tables[k],
                lidar=Sweeping(points[:, :3], points[:, 3], ROOF.vehicle_from_laser.translation),
                scene=name,
                previous=tokens[k],
                next=tokens[k + 2],
            )
        )
    return drive


def _drive_on(seconds: float) -> Pose:
    """By how much the vehicle is said to be elsewhere when a camera fires: the town takes all pictures at one instant."""
    return Pose.from_euler(0.2 * seconds, 0.01 * seconds, 0.0, (6.0 * seconds, 0.1 * seconds, 0.0))


def _boxes(frame: Frame) -> Boxes3D:
    assert frame.boxes_world is not None
    return frame.boxes_world


def _with_velocities(tables: list[Boxes3D], times_s: list[float]) -> list[Boxes3D]:
    """Difference over the frame before and after, one-sided at the ends, unknown for what one frame alone shows.

    What comes, goes and comes again is left out: formats with links between annotations tell its speed across the gap, others
    do not.
    """
    places = [dict(zip(t.instance_ids.tolist(), t.centre_m, strict=True)) for t in tables]
    seen = {name: [k for k, there in enumerate(places) if name in there] for there in places for name in there}
    steady = {name for name, when in seen.items() if all(b - a == 1 for a, b in pairwise(when))}
    found = []
    for k, table in enumerate(tables):
        kept = table[np.isin(table.instance_ids, list(steady))]
        velocity = np.full((len(kept), 2), np.nan)
        for row, name in enumerate(kept.instance_ids.tolist()):
            near = [i for i in seen[name] if abs(i - k) <= 1]
            if len(near) > 1:
                moved = places[near[-1]][name] - places[near[0]][name]
                velocity[row] = moved[:2] / (times_s[near[-1]] - times_s[near[0]])
        found.append(replace(kept, velocity_mps=velocity))
    return found


def _sweep(points_ego: np.ndarray, intensity: np.ndarray, pose: Pose) -> Sweep:
    """Each point goes to the pixel that looks nearest to it; the vehicle drives on by 40 cm while the laser turns."""
    returns = np.full((2, len(ROOF.inclinations_rad), COLUMNS, 4), -1.0, dtype=np.float32)
    x, y, z = ROOF.vehicle_from_laser.inverse().apply(points_ego).T
    metres = np.sqrt(x * x + y * y + z * z)
    from_lowest = np.abs(np.arcsin(z / metres)[:, None] - np.array(ROOF.inclinations_rad)).argmin(1)
    mounted = ROOF.vehicle_from_laser.rotation
    turn = (np.arctan2(y, x) + np.arctan2(mounted[1, 0], mounted[0, 0]) + np.pi) / (2 * np.pi)
    column = np.floor((1 - turn % 1) * COLUMNS).astype(int) % COLUMNS
    for i, j, r, bright in zip(len(ROOF.inclinations_rad) - 1 - from_lowest, column, metres, intensity, strict=True):
        if r < returns[0, i, j, 0] or returns[0, i, j, 0] < 0:
            returns[0, i, j, :2] = r, bright
    poses = np.zeros((*returns.shape[1:3], 6), dtype=np.float32)
    yaw, pitch, roll = euler_rad(pose.rotation)
    for j in range(COLUMNS):
        place = pose.apply(np.array([0.4 * (j / COLUMNS - 0.5), 0.0, 0.0]))
        poses[:, j] = (roll, pitch, yaw, *place)
    assert np.allclose(pixel_pose(poses[0, 0]).rotation, pose.rotation, atol=1e-6)
    return Sweep((returns[0], returns[1]), poses)
