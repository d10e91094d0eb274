"""Speed of the renderer of Gaussians: native code per instruction set, and a plain vectorised torch renderer beside it.

Run ``python benchmarks/render.py``; figures go to results/benchmarks/render.json. The scene has 2.16 million Gaussians, one
per pixel of six 800x450 images of a street that is ray-cast here (ground, house fronts, cars, a far backdrop). It is rendered
through the rigs of the presets, scaled to 704 pixels of width and cropped to the bottom 256 rows. Each figure is a median over
repetitions of whole rigs, divided by the number of cameras. Preparation (bounding spheres) is timed by itself.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import torch

from coin3d.geometry import Camera, Rig, fit_width, preset_rig
from coin3d.records import write_json
from coin3d.rendering import Gaussians, prepare
from coin3d.rendering.cpu import instruction_sets, render_cpu
from torch_splats import render_torch

RESULT = Path(__file__).resolve().parents[1] / "results" / "benchmarks" / "render.json"
BUSY_LOAD_PER_CORE = 0.5
BACKDROP_M = 90.0


@dataclass(frozen=True)
class Timing:
    """One row: what rendered which views, and milliseconds per image."""

    views: str
    renderer: str
    threads: int
    wall_ms: float
    cpu_ms: float


def street_boxes() -> np.ndarray:
    """(b, 2, 3) lowest and highest corner of house fronts and parked cars, ego frame."""
    rng = np.random.default_rng(0)
    boxes = []
    for side in (-1, 1):
        x = -BACKDROP_M
        while x < BACKDROP_M:
            length, gap, setback = rng.uniform(8, 20), rng.choice([0, 0, 6]), rng.uniform(9, 14)
            y = sorted((side * setback, side * (setback + 10)))
            boxes.append([[x, y[0], 0], [x + length, y[1], rng.uniform(6, 15)]])
            x += length + gap
        for x in np.arange(-60, 60, 7.0) + rng.uniform(0, 2):
            y = sorted((side * 4.5, side * 6.4))
            boxes.append([[x, y[0], 0], [x + 4.5, y[1], rng.uniform(1.4, 2)]])
    return np.array(boxes)


def cast(origin: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance along each ray to the nearest surface, and which surface: box number, -1 ground, -2 backdrop."""
    with np.errstate(divide="ignore"):
        ground = np.where(rays[:, 2] < 0, -origin[2] / rays[:, 2], np.inf)
        nearest = BACKDROP_M / np.linalg.norm(rays, axis=1)
        surface = np.where(ground < nearest, -1, -2)
        nearest = np.minimum(ground, nearest)
        inverse = 1 / np.where(rays == 0, 1e-12, rays)
    for i, (low, high) in enumerate(street_boxes()):
        a, b = (low - origin) * inverse, (high - origin) * inverse
        enter, leave = np.minimum(a, b).max(1), np.maximum(a, b).min(1)
        hit = (enter < leave) & (enter > 0) & (enter < nearest)
        nearest, surface = np.where(hit, enter, nearest), np.where(hit, i, surface)
    return nearest, surface


def camera_points(camera: Camera) -> Gaussians:
    """One Gaussian per pixel, in 16x16 tiles of the image; radii as released: 0.02 m at the ground to 0.001 m at 5 m."""
    tile = np.arange(camera.height_px)[:, None] // 16 * 10**6 + np.arange(camera.width_px)[None] // 16
    order = np.argsort(tile.ravel(), kind="stable")
    rays = camera.rays_ego(camera.pixel_grid()).reshape(-1, 3)[order]
    distance, surface = cast(camera.ego_from_cam.translation, rays)
    points = camera.ego_from_cam.translation + distance[:, None] * rays
    height = np.clip(points[:, 2], 0, 5) / 5
    std_m = np.where((surface >= 0) & (points[:, 2] < 2.2), 0.0025, 0.02 + height * (0.001 - 0.02))
    rng = np.random.default_rng(1)
    base = np.random.default_rng(2).integers(40, 216, (len(street_boxes()) + 2, 3))[surface]
    rgb = np.clip(base + rng.integers(-20, 21, (len(base), 1)), 0, 255)
    return Gaussians(points.astype(np.float32), std_m.astype(np.float32), rgb.astype(np.uint8))


def rig_views(name: str) -> list[Camera]:
    return [fit_width(c, 704, 256).camera(c) for c in preset_rig(name).values()]


def street() -> Gaussians:
    rig: Rig = preset_rig("nuscenes", 800)
    return Gaussians.concatenate(camera_points(camera) for camera in rig.values())


def median_times(work: Callable[[], object], repetitions: int, images: int) -> tuple[float, float]:
    """Median wall and processor milliseconds per image, after one run that is not counted."""
    work()
    wall, cpu = [], []
    for _ in range(repetitions):
        began, began_cpu = time.perf_counter(), time.process_time()
        work()
        wall.append(time.perf_counter() - began)
        cpu.append(time.process_time() - began_cpu)
    return round(1e3 * statistics.median(wall) / images, 2), round(1e3 * statistics.median(cpu) / images, 2)


def timed(views: str, renderer: str, threads: int, work: Callable[[], object], repetitions: int, images: int) -> Timing:
    row = Timing(views, renderer, threads, *median_times(work, repetitions, images))
    print(f"{views:9} {renderer:10} {threads:7}  {row.wall_ms:8.2f} {row.cpu_ms:8.2f}   {1e3 / row.wall_ms:8.1f}", flush=True)
    return row


def agree(gaussians: Gaussians, camera: Camera) -> None:
    """Both renderers draw the same picture, or the comparison means nothing."""
    colours, _, alpha = render_torch(gaussians, camera)
    (ours,) = render_cpu(gaussians, [camera])
    wrong = np.abs(colours.numpy() * 255 - ours.rgb).max(-1) > 4
    assert wrong.mean() < 1e-3 and np.abs(alpha.numpy() - ours.alpha).mean() < 1e-4, f"{wrong.mean():.2%} of pixels differ"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=RESULT)
    parser.add_argument("--repetitions", type=int, default=15)
    parser.add_argument("--no-torch", action="store_true", help="leave out the slow comparison")
    options = parser.parse_args()
    load, cores = os.getloadavg()[0], os.cpu_count() or 1
    print(f"{cores} cores, load average before {load:.2f}")
    if load > BUSY_LOAD_PER_CORE * cores:
        print(f"WARNING: the machine is busy (load above {BUSY_LOAD_PER_CORE} per core): wall times below are too long")
    gaussians = street()
    prepare_ms, _ = median_times(lambda: prepare(gaussians), options.repetitions, 1)
    scene = prepare(gaussians)
    print(f"{len(gaussians) / 1e6:.2f} million Gaussians, prepared in {prepare_ms} ms\n")
    print("views     renderer   threads   wall ms   cpu ms   images/s")
    rows = []
    for name in ("waymo", "nuscenes"):
        cameras = rig_views(name)

        for kind in instruction_sets():
            for threads in (1, 2):
                work = partial(render_cpu, scene, cameras, threads=threads, instruction_set=kind)
                rows.append(timed(name, kind, threads, work, options.repetitions, len(cameras)))
        if not options.no_torch:
            agree(gaussians, cameras[0])
            for threads in (1, 2):
                torch.set_num_threads(threads)
                rows.append(timed(name, "torch", threads, partial(render_torch, gaussians, cameras[0]), 3, 1))
    machine = {"cores": cores, "load_before": round(load, 2), "torch": torch.__version__, "gaussians": len(gaussians)}
    write_json(options.out, {**machine, "prepare_ms": prepare_ms, "rows": rows})
    print(f"figures in {options.out}")


if __name__ == "__main__":
    main()
