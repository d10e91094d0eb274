"""Fusion of LiDAR sweeps into a sparse field: native code against the same sums in vectorised numpy.

Run ``python benchmarks/tsdf.py``; figures go to ``results/benchmarks/tsdf.json``. The sweeps are those of a 32-beam LiDAR
driving down a street of walls and parked boxes, voxels of 0.1 m, truncation 0.3 m, each measurement into an empty volume.
Figures are medians over repetitions after one that is not counted.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coin3d.native import TsdfVolume
from coin3d.records import write_json
from coin3d.scenes.normals import free_directions
from coin3d.scenes.ray_cloud import RayCloud

BUSY_LOAD = 0.5
VOXEL_M, TRUNCATION_VOXELS = 0.1, 3.0
BEAMS, STEPS = 32, 1084


@dataclass(frozen=True)
class Timing:
    """One row of the table."""

    way: str
    threads: int
    million_points_per_s: float
    spread_percent: float


def street(sweeps: int) -> RayCloud:
    """Returns from the ground, two walls, and boxes along the kerb."""
    rng = np.random.default_rng(0)
    elevation = np.deg2rad(np.linspace(-30.67, 10.67, BEAMS))[:, None]
    azimuth = np.linspace(0, 2 * np.pi, STEPS, endpoint=False)[None]
    unit = [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation) + 0 * azimuth]
    rays = np.stack(unit, axis=-1).reshape(-1, 3)
    boxes = [
        (np.array([8.0 * i, side - 0.9, 0.0]), np.array([8.0 * i + 4.5, side + 0.9, 1.5]))
        for i in range(-8, 14)
        for side in (-5, 5)
    ]
    clouds = []
    for step in range(sweeps):
        sensor = np.array([0.5 * step, 0.0, 1.84])
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = np.minimum(np.where(rays[:, 2] < 0, -sensor[2] / rays[:, 2], np.inf), 12 / np.abs(rays[:, 1]))
            for low, high in boxes:
                a, b = (low - sensor) / rays, (high - sensor) / rays
                enter, leave = np.minimum(a, b).max(1), np.maximum(a, b).min(1)
                reach = np.where((enter < leave) & (enter > 0), np.minimum(reach, enter), reach)
        reach = reach + rng.normal(0, 0.015, len(reach))
        kept = (reach > 3) & (reach < 100)
        clouds.append(RayCloud.from_origin(sensor + rays[kept] * reach[kept, None], sensor))
    return RayCloud.concatenate(clouds)


def fuse_native(points_m: np.ndarray, toward: np.ndarray, threads: int) -> tuple[int, float]:
    """Number of voxels and sum of all mean distances."""
    volume = TsdfVolume(VOXEL_M, VOXEL_M * TRUNCATION_VOXELS)
    volume.integrate(points_m, toward, threads=threads)
    coords, value = np.empty((volume.blocks, 3), np.int32), np.empty((volume.blocks, 8, 8, 8), np.float32)
    volume.field(coords, value, 0.0, threads)
    return int((~np.isnan(value)).sum()), float(np.nansum(value, dtype=np.float64))


def integrate_native(points_m: np.ndarray, toward: np.ndarray, threads: int) -> None:
    TsdfVolume(VOXEL_M, VOXEL_M * TRUNCATION_VOXELS).integrate(points_m, toward, threads=threads)


def fuse_numpy(points_m: np.ndarray, toward: np.ndarray) -> tuple[int, float]:
    """The same voxels and distances: all updates listed, sorted by voxel, summed."""
    p, d = points_m * (1 / VOXEL_M), toward.astype(np.float64)
    rows = np.arange(len(p))
    a = np.abs(d).argmax(1)
    axis = np.stack([a, (a + 1) % 3, (a + 2) % 3], axis=1)
    p, d = p[rows[:, None], axis], d[rows[:, None], axis]
    reach = TRUNCATION_VOXELS * np.abs(d[:, 0])
    first, last = np.ceil(p[:, 0] - reach - 0.5), np.floor(p[:, 0] + reach - 0.5)
    keys, distances = [], []
    for layer in range(2 * int(TRUNCATION_VOXELS) + 1):
        k = first + layer
        along = k + 0.5 - p[:, 0]
        beside = np.floor(p[:, 1:] + (along / d[:, 0])[:, None] * d[:, 1:])
        distance = along * d[:, 0] + ((beside + 0.5 - p[:, 1:]) * d[:, 1:]).sum(1)
        used = (k <= last) & (np.abs(distance) <= TRUNCATION_VOXELS)
        voxel = np.empty((len(p), 3))
        voxel[rows[:, None], axis] = np.column_stack([k, beside])
        index = voxel[used].astype(np.int64) + (1 << 20)
        keys.append(index[:, 0] << 42 | index[:, 1] << 21 | index[:, 2])
        distances.append(distance[used])
    _, voxel_of, count = np.unique(np.concatenate(keys), return_inverse=True, return_counts=True)
    mean_m = np.bincount(voxel_of, np.concatenate(distances)) / count * VOXEL_M
    return len(count), float(mean_m.sum())


def measure(way: str, threads: int, run: Callable[[], object], points: int, repetitions: int) -> Timing:
    run()
    times = []
    for _ in range(repetitions):
        began = time.perf_counter()
        run()
        times.append(time.perf_counter() - began)
    middle = statistics.median(times)
    return Timing(way, threads, round(points / middle / 1e6, 2), round(100 * (max(times) - min(times)) / middle))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path(__file__).parents[1] / "results/benchmarks/tsdf.json")
    parser.add_argument("--repetitions", type=int, default=9)
    parser.add_argument("--sweeps", type=int, default=40)
    options = parser.parse_args()
    load = os.getloadavg()[0]
    busy = load > BUSY_LOAD
    print(f"{os.cpu_count()} cores, load average before {load:.2f}")
    if busy:
        print(f"WARNING: the machine is busy (load above {BUSY_LOAD}): times below are too long and ratios unreliable")
    cloud = street(options.sweeps)
    points, toward = cloud.points_m, free_directions(cloud, [0.4, 1.2], 0.04)
    (voxels, total), (plain_voxels, plain_total) = fuse_native(points, toward, 2), fuse_numpy(points, toward)
    assert voxels == plain_voxels and abs(total - plain_total) < 1e-5 * voxels, "native and numpy disagree"
    volume = TsdfVolume(VOXEL_M, VOXEL_M * TRUNCATION_VOXELS)
    volume.integrate(points, toward)
    print(
        f"{len(points) / 1e6:.2f} M points of {options.sweeps} sweeps, {voxels / 1e3:.0f} k voxels, {volume.bytes / 1e6:.0f} MB"
    )
    rows = [
        measure("native", n, lambda n=n: integrate_native(points, toward, n), len(points), options.repetitions) for n in (1, 2)
    ]
    rows.append(measure("numpy", 1, lambda: fuse_numpy(points, toward), len(points), max(2, options.repetitions // 4)))
    print("way     threads  M points/s  max - min, % of median")
    for r in rows:
        print(f"{r.way:7} {r.threads:7}  {r.million_points_per_s:10.2f}  {r.spread_percent:6.0f}")
    facts = {"cores": os.cpu_count(), "load_before": round(load, 2), "busy": busy, "points": len(points), "voxels": voxels}
    write_json(options.out, {**facts, "volume_mb": round(volume.bytes / 1e6, 1), "rows": rows})
    print(f"figures in {options.out}")


if __name__ == "__main__":
    main()
