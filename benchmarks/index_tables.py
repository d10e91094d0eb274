"""What opening a recording of nuScenes' size costs: making its index, opening it afterwards, and frames without images.

    python benchmarks/index_tables.py --scenes 85 --out results/benchmarks/index_tables.json

writes tables like those of nuScenes trainval (40 key frames per scene, 76 sample_data and ego_pose rows and 34 annotations per
key frame, calibrations per scene) with random contents, 850 scenes being the whole, and runs each step in a process of its own.
The peer is the plain way: all tables parsed at once with ``json.loads`` and put into dicts by token. Peak memory is the largest
resident set of the process; "imports" is what it is before anything is opened.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import random
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from hashlib import md5
from itertools import pairwise
from pathlib import Path
from typing import Any

from coin3d.datasets import nuscenes_index
from coin3d.datasets.nuscenes_format import NuScenesRecording
from coin3d.datasets.nuscenes_tables import TABLES
from coin3d.records import write_json

BUSY_LOAD = 0.5
SAMPLES, TRACKS, TRACK_LENGTH = 40, 34, 18
CAMERAS = ("CAM_FRONT", "CAM_FRONT_LEFT", "CAM_FRONT_RIGHT", "CAM_BACK", "CAM_BACK_LEFT", "CAM_BACK_RIGHT")
RADARS = ("RADAR_FRONT", "RADAR_FRONT_LEFT", "RADAR_FRONT_RIGHT", "RADAR_BACK_LEFT", "RADAR_BACK_RIGHT")
# rows per key frame, the key row among them: LiDAR at 20 Hz, cameras at 12 Hz, radars at 13 Hz
ROWS = {"LIDAR_TOP": 10, **dict.fromkeys(CAMERAS, 6), **dict.fromkeys(RADARS, 6)}
VERSION = "v1.0-made-up"
Row = dict[str, Any]


@dataclass(frozen=True)
class Step:
    """One row of the table."""

    what: str
    seconds: float
    peak_mb: float
    frames_per_second: float | None = None


def token(*parts: object) -> str:
    return md5("/".join(map(str, parts)).encode(), usedforsecurity=False).hexdigest()


def turn(rng: random.Random) -> list[float]:
    w = rng.uniform(-1, 1)
    return [w, 0.0, 0.0, (1 - w * w) ** 0.5]


def drive(s: int, time_us: int) -> Row:
    """Straight on at 7.3 m/s, another way in each scene."""
    metres = 7.3e-6 * (time_us % 60_000_000)
    yaw = 0.1 * s
    translation = [1000 + metres * math.cos(yaw), 1000 + metres * math.sin(yaw), 0.0]
    return {"rotation": [math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)], "translation": translation}


def place(rng: random.Random) -> list[float]:
    return [rng.uniform(0, 2000), rng.uniform(0, 2000), rng.uniform(0, 2)]


def calibrations(s: int, rng: random.Random) -> Iterator[Row]:
    for channel in ROWS:
        intrinsic = [[1266.4, 0.0, 816.3], [0.0, 1266.4, 491.5], [0.0, 0.0, 1.0]] if channel in CAMERAS else []
        yield {
            "token": token("calibration", s, channel),
            "sensor_token": token("sensor", channel),
            "translation": [rng.uniform(0, 2), rng.uniform(-1, 1), rng.uniform(1, 2)],
            "rotation": [0.5, -0.5, 0.5, -0.5],
            "camera_intrinsic": intrinsic,
        }


def data_rows(s: int) -> Iterator[tuple[str, int, Row]]:
    for channel, count in ROWS.items():
        size = {"width": 1600, "height": 900} if channel in CAMERAS else {"width": 0, "height": 0}
        ending = "jpg" if channel in CAMERAS else "pcd.bin"
        for k in range(SAMPLES):
            for part in range(count):
                time_us = 1_500_000_000_000_000 + s * 60_000_000 + k * 500_000 + part * 500_000 // count
                folder, name = "sweeps" if part else "samples", f"n015-2018-07-24-11-22-45+0800__{channel}__{time_us}.{ending}"
                mine = token("data", s, channel, k, part)
                row = {
                    "token": mine,
                    "sample_token": token("sample", s, k),
                    "ego_pose_token": mine,
                    "calibrated_sensor_token": token("calibration", s, channel),
                    "timestamp": time_us,
                    "fileformat": ending.partition(".")[0],
                    "is_key_frame": part == 0,
                    "height": size["height"],
                    "width": size["width"],
                    "filename": f"{folder}/{channel}/{name}",
                    "prev": token("data", s, channel, k, part - 1),
                    "next": token("data", s, channel, k, part + 1),
                }
                yield mine, time_us, row


def tracks(s: int) -> Iterator[tuple[str, list[int]]]:
    for slot in range(TRACKS):
        borders = sorted({0, SAMPLES, *range(slot % TRACK_LENGTH, SAMPLES, TRACK_LENGTH)})
        for first, end in pairwise(borders):
            yield token("instance", s, slot, first), list(range(first, end))


def annotations(s: int, rng: random.Random) -> Iterator[Row]:
    for instance, ks in tracks(s):
        names = ["", *(token("annotation", instance, k) for k in ks), ""]
        for i, k in enumerate(ks):
            yield {
                "token": names[i + 1],
                "sample_token": token("sample", s, k),
                "instance_token": instance,
                "visibility_token": str(rng.randint(1, 4)),
                "attribute_tokens": [token("attribute", k % 8)],
                "translation": place(rng),
                "size": [rng.uniform(0.5, 3), rng.uniform(0.5, 10), rng.uniform(1, 4)],
                "rotation": turn(rng),
                "prev": names[i],
                "next": names[i + 2],
                "num_lidar_pts": rng.randint(0, 200),
                "num_radar_pts": rng.randint(0, 5),
            }


def write_tables(root: Path, scenes: int) -> int:
    """Write the tables row by row; how many bytes."""
    folder = root / VERSION
    folder.mkdir(parents=True)
    categories = [f"category.{i}" for i in range(23)]
    rng = random.Random(0)
    rows: dict[str, Callable[[int], Iterator[Row]]] = {
        "scene": lambda s: iter([{"token": token("scene", s), "name": f"made-up-{s:04}", "nbr_samples": SAMPLES}]),
        "sample": lambda s: (
            {
                "token": token("sample", s, k),
                "timestamp": 1_500_000_000_000_000 + s * 60_000_000 + k * 500_000,
                "prev": token("sample", s, k - 1),
                "next": token("sample", s, k + 1),
                "scene_token": token("scene", s),
            }
            for k in range(SAMPLES)
        ),
        "sample_data": lambda s: (row for _, _, row in data_rows(s)),
        "ego_pose": lambda s: ({"token": mine, "timestamp": time_us, **drive(s, time_us)} for mine, time_us, _ in data_rows(s)),
        "calibrated_sensor": lambda s: calibrations(s, rng),
        "sensor": lambda s: (
            {"token": token("sensor", c), "channel": c, "modality": {"C": "camera", "L": "lidar", "R": "radar"}[c[0]]}
            for c in (() if s else ROWS)
        ),
        "sample_annotation": lambda s: annotations(s, rng),
        "instance": lambda s: (
            {"token": instance, "category_token": token(rng.choice(categories)), "nbr_annotations": len(ks)}
            for instance, ks in tracks(s)
        ),
        "category": lambda s: ({"token": token(c), "name": c} for c in (() if s else categories)),
    }
    for name in TABLES:
        with (folder / f"{name}.json").open("w") as file:
            separator = "[\n"
            for s in range(scenes):
                for row in rows[name](s):
                    file.write(separator + json.dumps(row))
                    separator = ",\n"
            file.write("\n]")
    return sum(path.stat().st_size for path in folder.iterdir())


def imports(root: Path, frames: int) -> None:
    """Nothing is opened."""


def index(root: Path, frames: int) -> None:
    for path in (root / VERSION).glob("*.index.records"):
        path.unlink()
    NuScenesRecording(root)


def opening(root: Path, frames: int) -> None:
    NuScenesRecording(root)


def plain_json(root: Path, frames: int) -> None:
    tables = {}
    for name in TABLES:
        rows = json.loads((root / VERSION / f"{name}.json").read_bytes())
        tables[name] = {row["token"]: row for row in rows}


def some_frames(root: Path, frames: int) -> float:
    """Frames at random places per second."""
    recording = NuScenesRecording(root)
    rng = random.Random(0)
    places = [rng.randrange(len(recording)) for _ in range(frames)]
    start = time.perf_counter()
    for i in places:
        recording[i]
    return frames / (time.perf_counter() - start)


STEPS: dict[str, Callable[[Path, int], float | None]] = {
    "imports": imports,
    "index made": index,
    "opened afterwards": opening,
    "frames without images": some_frames,
    "plain json.loads": plain_json,
}


def run(step: str, root: Path, frames: int) -> Step:
    """One step in this process."""
    nuscenes_index.SMALL_BYTES = 0
    start = time.perf_counter()
    rate = STEPS[step](root, frames)
    seconds = time.perf_counter() - start
    return Step(step, seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3, rate)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=85)
    parser.add_argument("--frames", type=int, default=500, help="how many are read")
    parser.add_argument("--folder", type=Path, help="where the tables are written; by default a temporary folder")
    parser.add_argument("--out", type=Path, help="JSON file for the figures")
    parser.add_argument("--step", nargs=2, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.step:
        print(json.dumps(vars(run(args.step[0], Path(args.step[1]), args.frames))))
        return
    load = os.getloadavg()[0]
    if load > BUSY_LOAD:
        print(f"the machine is busy (load {load:.1f}): the figures will be too low")
    with tempfile.TemporaryDirectory(dir=args.folder) as made:
        root = Path(made) / "recording"
        megabytes = write_tables(root, args.scenes) / 1e6
        print(f"{args.scenes} scenes, {args.scenes * SAMPLES} key frames, tables of {megabytes:.0f} MB")
        steps = []
        for name in STEPS:
            command = [sys.executable, __file__, "--frames", str(args.frames), "--step", name, str(root)]
            done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
            step = Step(**json.loads(done.stdout))
            rate = f"{step.frames_per_second:10.1f} frames/s" if step.frames_per_second else ""
            print(f"{step.what:25} {step.seconds:10.3f} s {step.peak_mb:8.0f} MB {rate}")
            steps.append(step)
        index_mb = sum(path.stat().st_size for path in root.glob("*/*.index.records")) / 1e6
        print(f"the index has {index_mb:.1f} MB")
    if args.out:
        figures = {"load": load, "scenes": args.scenes, "tables_mb": megabytes, "index_mb": index_mb, "steps": steps}
        write_json(args.out, figures)


if __name__ == "__main__":
    main()
