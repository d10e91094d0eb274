"""Time and memory of the detection metric, against nuscenes-devkit and at the size of a whole validation set.

    python benchmarks/evaluate_speed.py --out results/benchmarks/evaluate.json

``against the devkit``: 6,000 samples of random boxes, in the memory of each evaluator before its clock starts (columns and
``Boxes3D`` per sample for ours, ``EvalBoxes`` for the devkit); AP at four thresholds and three errors for three classes. The
devkit runs once, in the same run, in the Python that the environment variable COIN3D_DEVKIT_PYTHON names
(tests/evaluation/devkit-requirements.txt). ``large``: 40,000 samples in a fresh process; ``seconds`` is matching and numbers,
``seconds_with_filters`` the whole of ``score_tables``: limit, range, cameras of every sample, and the unfiltered numbers.
Seconds of ours are medians; peak memory is that of the process, boxes included.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from coin3d.evaluation import BoxTable

BUSY_LOAD = 0.5
CLASSES = ("car", "pedestrian", "two-wheel")
COLUMNS = ("start", "label", "centre_m", "size_m", "yaw_rad", "score")


def random_tables(samples: int, boxes: int, objects: int) -> tuple[BoxTable, BoxTable]:
    """Objects at random places; detections are noisy copies of most of them, the rest is at random places."""
    from coin3d.evaluation import BoxTable

    rng = np.random.default_rng(0)

    def table(per_sample: int) -> dict[str, Any]:
        n = samples * per_sample
        centre = np.empty((n, 3))
        centre[:, :2], centre[:, 2] = rng.uniform(-50, 50, (n, 2)), 1.0
        return {
            "tokens": tuple(f"sample {i}" for i in range(samples)),
            "start": np.arange(samples + 1) * per_sample,
            "classes": CLASSES,
            "label": rng.integers(0, len(CLASSES), n).astype(np.int16),
            "centre_m": centre,
            "size_m": rng.uniform(0.5, 5, (n, 3)),
            "yaw_rad": rng.uniform(-3, 3, n),
            "score": rng.random(n),
        }

    truth, found = table(objects), table(boxes)
    copies = min(boxes, int(0.8 * objects))
    for name in ("label", "centre_m", "size_m", "yaw_rad"):
        of_truth = truth[name].reshape(samples, objects, -1)[:, :copies]
        noise = 0 if name == "label" else rng.normal(0, {"centre_m": 0.5, "size_m": 0.05, "yaw_rad": 0.2}[name], of_truth.shape)
        found[name].reshape(samples, boxes, -1)[:, :copies] = of_truth + noise
    found["score"].reshape(samples, boxes)[:, :copies] **= 0.05  # confident, mostly
    return BoxTable(**truth), BoxTable(**found)


def seconds(run: Callable[[], object], repetitions: int) -> float:
    times = []
    for _ in range(repetitions):
        began = time.perf_counter()
        run()
        times.append(time.perf_counter() - began)
    return statistics.median(times)


def against_devkit(python: str, samples: int, boxes: int, objects: int) -> dict[str, Any]:
    from coin3d.evaluation import Protocol, evaluate, match
    from coin3d.evaluation.metrics import metrics_of

    truth, found = random_tables(samples, boxes, objects)
    with tempfile.TemporaryDirectory() as folder:
        tables = {"truth": truth, "found": found}
        for name, table in tables.items():
            np.savez(Path(folder) / f"{name}.npz", **{column: getattr(table, column) for column in COLUMNS})
        clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
        done = subprocess.run([python, __file__, "--devkit", folder], capture_output=True, text=True, check=True, env=clean)
    devkit = json.loads(done.stdout.splitlines()[-1])
    protocol = Protocol()
    metrics = metrics_of(match(truth, found, protocol))
    differences = []
    for name, ours in metrics.classes.items():
        theirs = devkit["metrics"][name]
        differences += np.subtract(
            [*ours.ap_at.values(), ours.ate, ours.ase, ours.aoe], theirs["ap"] + theirs["errors"]
        ).tolist()
    from_columns = seconds(lambda: metrics_of(match(truth, found, protocol)), 5)
    by_sample = [{token: table.boxes_of(token) for token in table.tokens} for table in (truth, found)]
    from_boxes = seconds(lambda: evaluate(*by_sample, protocol), 3)
    return {
        "samples": samples,
        "predicted_boxes": len(found),
        "truth_boxes": len(truth),
        "seconds": round(from_columns, 3),
        "seconds_from_boxes_of_samples": round(from_boxes, 3),
        "seconds_devkit": round(devkit["seconds"], 2),
        "ratio": round(devkit["seconds"] / from_columns, 1),
        "ratio_from_boxes_of_samples": round(devkit["seconds"] / from_boxes, 1),
        "mAP": round(metrics.mean_ap, 4),
        "largest_difference": float(np.abs(differences).max()),
    }


def run_devkit(folder: Path) -> None:
    """In the devkit's Python: build its boxes, then time its metric."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests/evaluation"))
    import devkit_oracle

    def boxes(name: str) -> Any:
        columns = dict(np.load(folder / f"{name}.npz"))
        start = columns.pop("start")
        label, centre, size, yaw, score = (columns[c].tolist() for c in COLUMNS[1:])
        rows = [
            {"name": CLASSES[label[i]], "centre": centre[i], "size_lwh": size[i], "yaw": yaw[i], "score": score[i]}
            for i in range(len(label))
        ]
        return devkit_oracle.eval_boxes({f"sample {s}": rows[start[s] : start[s + 1]] for s in range(len(start) - 1)})

    truth, found = boxes("truth"), boxes("found")
    began = time.perf_counter()
    metrics = devkit_oracle.metrics(truth, found)
    print(json.dumps({"seconds": time.perf_counter() - began, "metrics": metrics}))


def large(samples: int, boxes: int, objects: int) -> dict[str, Any]:
    from coin3d.evaluation import Protocol, match, score_tables
    from coin3d.evaluation.metrics import metrics_of
    from coin3d.geometry import preset_rig

    truth, found = random_tables(samples, boxes, objects)
    protocol, rig = Protocol(), preset_rig("nuscenes")
    peak_gib = [_peak_gib()]
    metric = seconds(lambda: metrics_of(match(truth, found, protocol)), 3)
    peak_gib.append(_peak_gib())
    filtered = seconds(lambda: score_tables(truth, found, dict.fromkeys(truth.tokens, rig), protocol), 1)
    peak_gib.append(_peak_gib())
    return {
        "samples": samples,
        "predicted_boxes": len(found),
        "truth_boxes": len(truth),
        "seconds": round(metric, 2),
        "seconds_with_filters": round(filtered, 2),
        "peak_gib_boxes_alone": round(peak_gib[0], 2),
        "peak_gib": round(peak_gib[1], 2),
        "peak_gib_with_filters": round(peak_gib[2], 2),
    }


def _peak_gib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="write the figures to this JSON file")
    parser.add_argument("--samples", type=int, default=6000, help="for the comparison with the devkit; 0 leaves it out")
    parser.add_argument("--large-samples", type=int, default=40_000, help="0 leaves this part out")
    parser.add_argument("--boxes", type=int, default=500, help="detections per sample in the large part")
    parser.add_argument(
        "--devkit-boxes",
        type=int,
        default=100,
        help="the same in the comparison; with 500 the devkit takes a quarter of an hour",
    )
    parser.add_argument("--objects", type=int, default=30, help="objects per sample")
    parser.add_argument("--devkit", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--one-large", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.devkit:
        run_devkit(options.devkit)
        return
    if options.one_large:
        print(json.dumps(large(options.large_samples, options.boxes, options.objects)))
        return
    load = os.getloadavg()[0]
    print(f"{os.cpu_count()} cores, load average before {load:.2f}")
    if load > BUSY_LOAD:
        print(f"WARNING: the machine is busy (load above {BUSY_LOAD}): times below are too long and ratios unreliable")
    result: dict[str, Any] = {"cores": os.cpu_count(), "load_before": round(load, 2), "busy": load > BUSY_LOAD}
    if options.samples:
        python = os.environ.get("COIN3D_DEVKIT_PYTHON", str(Path(__file__).resolve().parents[1] / ".venv-devkit/bin/python"))
        result["against_devkit"] = against_devkit(python, options.samples, options.devkit_boxes, options.objects)
        print(json.dumps(result["against_devkit"], indent=1), flush=True)
    if options.large_samples:
        sizes = [("--large-samples", options.large_samples), ("--boxes", options.boxes), ("--objects", options.objects)]
        words = [str(word) for pair in sizes for word in pair]
        done = subprocess.run([sys.executable, __file__, "--one-large", *words], capture_output=True, text=True, check=True)
        result["large"] = json.loads(done.stdout.splitlines()[-1])
        print(json.dumps(result["large"], indent=1))
    if options.out:
        from coin3d.records import write_json

        write_json(options.out, result)
        print(f"figures in {options.out}")


if __name__ == "__main__":
    main()
