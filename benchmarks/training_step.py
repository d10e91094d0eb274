"""Seconds of a training step at preset `tiny`, and the minutes of the preset's steps that follow, on an idle machine.

    python benchmarks/training_step.py --out results/benchmarks/training_step.json

Each row trains on a small recording of the town for a few steps, after ten that are not counted, as `coin3d train` does it. The
rows of results/town_transfer tell what whole runs took on a machine that did other work as well.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import torch

from coin3d.datasets.classes import MERGED_CAR
from coin3d.detectors import DETECTORS
from coin3d.geometry import preset_rig
from coin3d.methods import METHODS, CoIn3DOptions
from coin3d.records import write_json
from coin3d.town import record
from coin3d.training.loop import LOG_FILE
from coin3d.training.options import TrainOptions
from coin3d.training.train import train

BUSY_LOAD = 0.5
NOT_COUNTED = 10


def measure(detector: str, method: str, data: Path, steps: int) -> dict[str, Any]:
    """One row."""
    options = CoIn3DOptions(placement="released" if detector == "bevdepth" else "paper")
    with tempfile.TemporaryDirectory() as out:
        train(
            [data], Path(out), detector=detector, config=DETECTORS[detector][0].tiny(), method=method,
            method_options=options if method == "coin3d" else METHODS[method][0](), class_map=MERGED_CAR,
            options=replace(TrainOptions.tiny(), steps=NOT_COUNTED + steps), progress=lambda line: None,
        )  # fmt: skip
        log = [json.loads(line) for line in (Path(out) / LOG_FILE).read_text(encoding="utf-8").splitlines()]
    seconds = median(step["seconds"] for step in log[NOT_COUNTED:])
    preset = TrainOptions.tiny().steps
    return {
        "detector": detector,
        "method": method,
        "seconds_per_step": round(seconds, 3),
        "preset_steps": preset,
        "preset_minutes": round(seconds * preset / 60, 1),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="write the figures to this JSON file")
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--detectors", nargs="+", choices=[*DETECTORS], default=[*DETECTORS])
    arguments = parser.parse_args()
    load = os.getloadavg()[0]
    print(f"{torch.get_num_threads()} threads, torch {torch.__version__}, load average before {load:.2f}")
    if load > BUSY_LOAD:
        print(f"WARNING: the machine is busy (load above {BUSY_LOAD}): times below are too long")
    with tempfile.TemporaryDirectory() as folder:
        data = record(preset_rig("nuscenes", 400), Path(folder) / "town", seeds=[0, 1], key_frames=4, workers=2)
        rows = []
        for detector in arguments.detectors:
            for method in ("direct", "coin3d") if detector == "bevdepth" else ("none", "coin3d"):
                rows.append(row := measure(detector, method, data, arguments.steps))
                print(
                    f"{detector:10} {method:7} {row['seconds_per_step']:.3f} s per step: {row['preset_minutes']:.1f} minutes "
                    f"for {row['preset_steps']} steps",
                    flush=True,
                )
    if arguments.out:
        machine = {"threads": torch.get_num_threads(), "torch": torch.__version__, "load_before": round(load, 2)}
        write_json(arguments.out, {**machine, "rows": rows})


if __name__ == "__main__":
    main()
