"""Write one drive in every format that is read, for benchmarks/reading_speed.py: the same content, so that formats compare.

    python benchmarks/every_format.py data/waymo out/formats
    python benchmarks/reading_speed.py out/formats/* --out results/benchmarks/reading_formats.json

Images, boxes and cameras are those of the first frame of a Waymo recording, the images as JPEG of quality 95 everywhere. LiDAR
is made: the top laser's full grid (64 rows of 2,650) over flat ground between walls, so that every pixel has a return, which is
somewhat more than real ones have. The writers are those of the tests.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from coin3d.datasets.frame import Frame
from coin3d.datasets.open import open_recording
from coin3d.geometry import BrownConrady, Pose
from dgp_writer import write_dgp
from own_writer import write_own
from table_writer import write_lyft, write_nuscenes
from town_drives import relabelled
from waymo_drive import JPEG, Drive, Laser, Sweep, euler_rad, pixel_direction
from waymo_writer import write_v1, write_v2

FRAMES = 4
ROWS, COLUMNS = 64, 2650
WALL_M = 40.0
TOP = Laser(Pose.from_euler(2.6, 0.0, 0.0, (1.43, 0.0, 2.18)), -0.31, 0.04, np.linspace(-0.31, 0.04, ROWS).tolist())
NAMES = {
    "nuscenes": ("vehicle.car", "human.pedestrian.adult", "vehicle.bicycle", "movable_object.barrier"),
    "lyft": ("car", "pedestrian", "bicycle", "other_vehicle"),
    "dgp": ("Car", "Person", "Bicycle", "Truck"),
    "own": ("vehicle.car", "human.pedestrian.adult", "vehicle.bicycle", "movable_object.barrier"),
}


def sweep(pose: Pose) -> Sweep:
    """Every pixel meets the ground or a round wall; the vehicle stands still."""
    returns = np.full((2, ROWS, COLUMNS, 4), -1.0, dtype=np.float32)
    down = np.array([-pixel_direction(TOP, i, 0, ROWS, COLUMNS)[2] for i in range(ROWS)])
    height_m = TOP.vehicle_from_laser.translation[2]
    returns[0, :, :, 0] = np.minimum(height_m / np.maximum(down, 1e-6), WALL_M)[:, None]
    returns[0, :, :, 1:3] = 0.2
    yaw, pitch, roll = euler_rad(pose.rotation)
    poses = np.broadcast_to(np.array([roll, pitch, yaw, *pose.translation], dtype=np.float32), (ROWS, COLUMNS, 6))
    return Sweep((returns[0], returns[1]), poses)


def drive_of(recording: Path) -> Drive:
    """The first frame of a Waymo recording, several times, half a second apart."""
    frame = open_recording(recording, undistort=False)[0]
    lens = next(iter(frame.rig.values())).lens
    distortion = [lens.k1, lens.k2, lens.p1, lens.p2, lens.k3] if isinstance(lens, BrownConrady) else [0.0] * 5
    tokens = ["", *(f"drive-{frame.timestamp_ns // 1000 + 500_000 * k}" for k in range(FRAMES)), ""]
    frames = [
        replace(
            frame,
            token=tokens[k + 1],
            timestamp_ns=frame.timestamp_ns + 500_000_000 * k,
            images={name: frame.image(name) for name in frame.rig},
            scene="drive",
            previous=tokens[k],
            next=tokens[k + 2],
        )
        for k in range(FRAMES)
    ]
    still = [dict.fromkeys(frame.rig, frame.world_from_ego)] * FRAMES
    sweeps = [{"TOP": sweep(frame.world_from_ego)}] * FRAMES
    return Drive("drive", frames, dict(frame.rig), distortion, still, {"TOP": TOP}, sweeps, codec=JPEG)


def with_lidar_of(drive: Drive, read: list[Frame]) -> Drive:
    """What the range images stand for, for formats that store points."""
    return replace(drive, frames=[replace(f, lidar=r.lidar) for f, r in zip(drive.frames, read, strict=True)])


def add_map(root: Path) -> None:
    """A map of nothing: nuscenes-devkit opens no recording without."""
    (root / "maps").mkdir()
    JPEG.write(root / "maps" / "none.jpg", np.zeros((8, 8, 3), dtype=np.uint8))
    row = {"token": "none", "log_tokens": [], "category": "semantic_prior", "filename": "maps/none.jpg"}
    next(root.glob("*/map.json")).write_text(json.dumps([row]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path, help="of the Waymo Open Dataset")
    parser.add_argument("out", type=Path)
    options = parser.parse_args()
    drive = drive_of(options.recording)
    (options.out / "waymo_v1").mkdir(parents=True)
    write_v1(options.out / "waymo_v1" / "drive.tfrecord", drive)
    write_v2(options.out / "waymo_v2", drive)
    drive = with_lidar_of(drive, list(open_recording(options.out / "waymo_v1")))
    writers: dict[str, Callable[[Path, list[Drive]], Path]] = {
        "nuscenes": write_nuscenes, "lyft": write_lyft, "dgp": write_dgp, "own": write_own,
    }  # fmt: skip
    for name, write in writers.items():
        waymo = ("VEHICLE", "PEDESTRIAN", "CYCLIST", "SIGN")
        write(options.out / name, [relabelled(drive, dict(zip(waymo, NAMES[name], strict=True)))])
    add_map(options.out / "nuscenes")
    for folder in sorted(options.out.iterdir()):
        frame = open_recording(folder)[0]
        points = 0 if frame.lidar is None else len(frame.lidar.load().points_ego)
        print(f"{folder}: {len(frame.rig)} images, {0 if frame.boxes is None else len(frame.boxes)} boxes, {points} points")


if __name__ == "__main__":
    main()
