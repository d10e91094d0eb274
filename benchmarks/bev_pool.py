"""Time and memory of lift-splat pooling: native code against the plain outer product with index_add.

Run ``python benchmarks/bev_pool.py``; ``--out FILE`` also writes the figures as JSON. Each figure is the median over
repetitions of one forward and backward pass, after one that is not counted. Indices are those of a real rig (the nuScenes
preset), so cells are hit as unevenly as in use.
"""

from __future__ import annotations

import argparse
import ctypes
import math
import os
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from coin3d.detectors import BEVDepthConfig
from coin3d.detectors.bev_pool import bev_pool
from coin3d.detectors.lift_splat import LiftSplat
from coin3d.geometry import fit_width, preset_rig
from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.records import write_json

BUSY_LOAD = 0.5
SIZES: dict[str, BEVDepthConfig] = {"paper": BEVDepthConfig.paper(), "tiny": BEVDepthConfig.tiny()}
Pool = Callable[[Tensor, Tensor, Tensor, int], Tensor]


@dataclass(frozen=True)
class Problem:
    """Inputs of one pooling: P pixels, D depth bins, C channels, N cells."""

    depth: Tensor
    context: Tensor
    cell: Tensor
    num_cells: int

    @property
    def outer_product_mb(self) -> float:
        """Size of the (P, D, C) tensor that the plain version stores in float32."""
        return self.depth.numel() * self.context.shape[1] * 4 / 1e6


@dataclass(frozen=True)
class Timing:
    """One row of the table."""

    size: str
    pixels: int
    bins: int
    channels: int
    cells: int
    native_ms: float
    plain_ms: float
    ratio: float
    native_peak_mb: float
    plain_peak_mb: float
    outer_product_mb: float


def problem(config: BEVDepthConfig) -> Problem:
    """Random features of one six-camera frame, with the cells its cameras see."""
    width, height = config.image_width_px, config.image_height_px
    rig = preset_rig("nuscenes")
    cameras = CameraTensors.from_cameras(
        [fit_width(c, width, height).camera(c) for c in rig.values()], [rig.ground for _ in rig]
    )
    lift = LiftSplat(config.grid, config.bins, config.strides[0])
    cell = lift.cells(cameras, torch.zeros(len(rig), dtype=torch.long), torch.eye(3)[None])
    torch.manual_seed(0)
    depth = torch.rand(cell.shape).flatten(0, 2).softmax(dim=1)
    context = torch.randn(len(depth), config.context_channels)
    return Problem(depth, context, cell.flatten(0, 2), config.grid.side**2 * config.grid.slabs)


def outer_product_pool(depth: Tensor, context: Tensor, cell: Tensor, num_cells: int) -> Tensor:
    """The textbook version: store every point's weighted feature, then sum them by cell."""
    points = (depth[:, :, None] * context[:, None]).flatten(0, 1)
    rows = torch.where(cell < 0, num_cells, cell).flatten().long()
    return points.new_zeros(num_cells + 1, context.shape[1]).index_add(0, rows, points)[:num_cells]


def once(pool: Pool, given: Problem) -> float:
    """Seconds of a forward and backward pass."""
    depth, context = given.depth.clone().requires_grad_(), given.context.clone().requires_grad_()
    began = time.perf_counter()
    pool(depth, context, given.cell, given.num_cells).sum().backward()
    return time.perf_counter() - began


def median_ms(pool: Pool, given: Problem, repetitions: int) -> float:
    once(pool, given)
    return 1e3 * statistics.median(once(pool, given) for _ in range(repetitions))


def peak_mb(pool: Pool, given: Problem) -> float:
    """Resident memory that one pass adds at its worst; Linux keeps the mark, elsewhere it is not a number."""
    reset, status = Path("/proc/self/clear_refs"), Path("/proc/self/status")
    if not status.is_file():
        return math.nan
    once(pool, given)  # what the libraries keep is not the pass's,
    ctypes.CDLL(None).malloc_trim(0)  # and what they freed is
    reset.write_text("5")  # proc(5): the high-water mark becomes the present size
    before = _kilobytes(status, "VmRSS")
    once(pool, given)
    return (_kilobytes(status, "VmHWM") - before) / 1e3


def _kilobytes(status: Path, key: str) -> int:
    return next(int(line.split()[1]) for line in status.read_text().splitlines() if line.startswith(key))


def measure(size: str, repetitions: int) -> Timing:
    given = problem(SIZES[size])
    assert torch.allclose(bev_pool(*vars(given).values()), outer_product_pool(*vars(given).values()), atol=1e-3)
    (pixels, bins), channels = given.depth.shape, given.context.shape[1]
    native, plain = median_ms(bev_pool, given, repetitions), median_ms(outer_product_pool, given, repetitions)
    return Timing(
        size=size,
        pixels=pixels,
        bins=bins,
        channels=channels,
        cells=given.num_cells,
        native_ms=round(native, 2),
        plain_ms=round(plain, 2),
        ratio=round(plain / native, 1),
        native_peak_mb=round(peak_mb(bev_pool, given), 1),
        plain_peak_mb=round(peak_mb(outer_product_pool, given), 1),
        outer_product_mb=round(given.outer_product_mb, 1),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="write the figures to this JSON file")
    parser.add_argument("--repetitions", type=int, default=15)
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    load = os.getloadavg()[0]
    print(f"{options.threads} threads, torch {torch.__version__}, load average before {load:.2f}")
    if load > BUSY_LOAD:
        print(f"WARNING: the machine is busy (load above {BUSY_LOAD}): times below are too long and ratios unreliable")
    rows = [measure(size, options.repetitions) for size in SIZES]
    print("size   pixels  bins  channels  cells   native ms  plain ms  ratio   native MB  plain MB  (outer product MB)")
    for r in rows:
        print(
            f"{r.size:6} {r.pixels:6}  {r.bins:4}  {r.channels:8}  {r.cells:5}  {r.native_ms:9.1f}  {r.plain_ms:8.1f}  "
            f"{r.ratio:4.1f}x  {r.native_peak_mb:9.1f}  {r.plain_peak_mb:8.1f}  {r.outer_product_mb:8.1f}"
        )
    if options.out:
        machine = {"threads": options.threads, "torch": torch.__version__, "load_before": round(load, 2)}
        write_json(options.out, {**machine, "rows": rows})
        print(f"figures in {options.out}")


if __name__ == "__main__":
    main()
