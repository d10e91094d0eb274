"""Latency and memory of each detector at the paper's size, with SFM and without, on rigs of six and five cameras.

    python benchmarks/latency.py --out results/benchmarks/latency.json

BEVDepth looks at two frames, BEVFormer at three, PETR at one, as in the paper; earlier frames are looked at anew. The vehicle
moves by the same metre each time: where BEVDepth's frame before falls is then remembered as well, which on the road it is not.
Each row is a process of its own and tells the median of forward passes of one frame, after a first one (``cold``) in which the
rig is new; afterwards everything that depends on the rig alone is remembered. SFM off and on take turns, so that a slow moment
meets both. Peak memory is that of the process after its first pass without SFM. Weights are random, which changes neither time
nor memory; boxes are not read off.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

BUSY_LOAD = 0.5
RIGS = ("nuscenes", "waymo")
PRECISIONS = ("float32", "bfloat16")


def batch_of(rig_name: str, width: int, height: int, frames: int) -> Any:
    """Noise through a rig, with the frames before at a metre each."""
    import numpy as np

    from coin3d.detectors import Sample, collate
    from coin3d.geometry import fit_width, preset_rig

    rig = preset_rig(rig_name)
    cameras = tuple(fit_width(c, width, height).camera(c) for c in rig.values())
    images = np.random.default_rng(0).integers(0, 255, (len(cameras), height, width, 3), dtype=np.uint8)
    sample = None
    for metres in range(frames - 1, -1, -1):
        motion = np.eye(4)
        motion[0, 3] = -metres
        sample = Sample(images, cameras, rig.ground, np.eye(3), key_from_ego=motion if metres else None, previous=sample)
    return collate([sample])


def measure(detector: str, rig: str, precision: str, repetitions: int) -> dict[str, Any]:
    """One row, in this process."""
    import torch

    from coin3d.detectors import DETECTORS
    from coin3d.methods import METHODS, CoIn3DOptions

    config_type, make = DETECTORS[detector]
    config = config_type.paper()
    batch = batch_of(rig, config.image_width_px, config.image_height_px, config.frames)
    seconds: dict[str, list[float]] = {"none": [], "coin3d": []}
    torch.manual_seed(0)
    options = {"none": METHODS["none"][0](), "coin3d": CoIn3DOptions(placement="paper")}
    models: dict[str, Any] = {}
    peak: dict[str, float] = {}
    with torch.no_grad(), torch.autocast("cpu", dtype=torch.bfloat16, enabled=precision == "bfloat16"):
        for _ in range(1 + repetitions):
            for method in seconds:
                if method not in models:
                    models[method] = make(config, ("car",), METHODS[method][1](options[method])).eval()
                began = time.perf_counter()
                models[method](batch)
                seconds[method].append(time.perf_counter() - began)
                peak.setdefault(method, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3)
    cold = {method: times.pop(0) for method, times in seconds.items()}
    warm = {method: statistics.median(times) for method, times in seconds.items()}
    pairs = [b / a - 1 for a, b in zip(*seconds.values(), strict=True)]
    return {
        "detector": detector,
        "rig": rig,
        "cameras": len(batch.cameras),
        "frames": config.frames,
        "size_px": [config.image_width_px, config.image_height_px],
        "precision": precision,
        "seconds": round(warm["none"], 3),
        "seconds_sfm": round(warm["coin3d"], 3),
        "sfm_adds": round(statistics.median(pairs), 4),
        "cold_seconds": round(cold["none"], 3),
        "cold_seconds_sfm": round(cold["coin3d"], 3),
        "peak_mb": round(peak["none"]),
        "threads": torch.get_num_threads(),
        "torch": torch.__version__,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="write the figures to this JSON file")
    parser.add_argument("--repetitions", type=int, default=7)
    parser.add_argument("--detectors", nargs="+", default=["bevdepth", "bevformer", "petr"])
    parser.add_argument("--one", nargs=3, metavar=("DETECTOR", "RIG", "PRECISION"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(measure(*options.one, options.repetitions)))
        return
    load = os.getloadavg()[0]
    if load > BUSY_LOAD:
        print(f"WARNING: the machine is busy (load average {load:.2f}): times below are too long")
    rows = []
    print("detector   rig       precision   seconds  with SFM   SFM adds   first pass   peak MB")
    for detector in options.detectors:
        for rig in RIGS:
            for precision in PRECISIONS:
                command = [sys.executable, __file__, "--repetitions", str(options.repetitions)]
                done = subprocess.run([*command, "--one", detector, rig, precision], capture_output=True, text=True, check=True)
                row = json.loads(done.stdout.splitlines()[-1])
                rows.append(row)
                print(
                    f"{detector:10} {rig:9} {precision:10} {row['seconds']:8.2f}  {row['seconds_sfm']:8.2f}   "
                    f"{row['sfm_adds']:8.1%}   {row['cold_seconds_sfm']:10.2f}   {row['peak_mb']:7}",
                    flush=True,
                )
    if options.out:
        from coin3d.records import write_json

        write_json(options.out, {"load_before": round(load, 2), "rows": rows})


if __name__ == "__main__":
    main()
