"""How long one process takes to read frames of a Waymo recording: opening, frames alone, with images, with LiDAR.

Run ``python benchmarks/waymo_reading.py data/waymo`` on a recording of either version. Its first ``--frames`` frames are read
in order, ``--repeats`` times, after one that is not counted. Medians are printed, and written to
``results/benchmarks/waymo_reading.json``. Files come from the page cache after the first time: what is measured is the work,
not the disk.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from coin3d.datasets.crc32c import crc32c
from coin3d.datasets.frame import Frame, Recording
from coin3d.datasets.open import open_recording
from coin3d.records import write_json

BUSY_LOAD = 0.5
CHECKED_BYTES = 1 << 24


@dataclass(frozen=True)
class Timing:
    """One row of the table."""

    what: str
    per_second: float
    unit: str


def images(frame: Frame) -> None:
    for name in frame.rig:
        frame.image(name)


def lidar(frame: Frame) -> None:
    if frame.lidar is not None:
        frame.lidar.load()


def frames_per_second(recording: Recording, count: int, repeats: int, use: Callable[[Frame], None]) -> float:
    use(recording[0])
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        for i in range(count):
            use(recording[i])
        seconds.append(time.perf_counter() - start)
    return count / statistics.median(seconds)


def measure(path: Path, frames: int, repeats: int) -> list[Timing]:
    start = time.perf_counter()
    recording = open_recording(path, undistort=False)
    opened_s = time.perf_counter() - start
    count = min(frames, len(recording))
    content = os.urandom(CHECKED_BYTES)
    crc32c(content)
    start = time.perf_counter()
    crc32c(content)
    checked_s = time.perf_counter() - start
    straight = open_recording(path)
    return [
        Timing("opening (with the index that was there, or was not)", len(recording) / opened_s, "frames/s"),
        Timing("checksum", CHECKED_BYTES / checked_s / 1e6, "MB/s"),
        Timing("frame without pixels and points", frames_per_second(recording, count, repeats, lambda _: None), "frames/s"),
        Timing("frame with five images", frames_per_second(recording, count, repeats, images), "frames/s"),
        Timing("frame with five undistorted images", frames_per_second(straight, count, repeats, images), "frames/s"),
        Timing("frame with LiDAR", frames_per_second(recording, count, repeats, lidar), "frames/s"),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--frames", type=int, default=50)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks/waymo_reading.json"))
    args = parser.parse_args()
    load = os.getloadavg()[0]
    if load > BUSY_LOAD:
        print(f"the machine is busy (load {load:.1f}): the figures will be too low")
    timings = measure(args.recording, args.frames, args.repeats)
    for timing in timings:
        print(f"{timing.what:55} {timing.per_second:10.1f} {timing.unit}")
    write_json(args.out, {"load": load, "timings": timings})


if __name__ == "__main__":
    main()
