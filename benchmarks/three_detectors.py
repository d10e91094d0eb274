"""How far does each detector carry from one rig to another? Direct transfer, CoIn3D and an oracle for all three.

    python benchmarks/three_detectors.py --work out/town_transfer

Recordings and Gaussians are those of benchmarks/town_transfer.py (in the same folder, made if need be). One image trunk is
trained per rig and shared by all rows that train on it; then every row gets the same steps at preset `tiny`. What exists is not
made again. Writes one small JSON per row into results/three_detectors/.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

from coin3d.augmentation import NovelViewOptions
from coin3d.datasets.classes import MERGED_CAR
from coin3d.datasets.open import open_recording
from coin3d.detectors import DETECTORS, BEVDepthConfig, TrunkConfig
from coin3d.evaluation import Protocol
from coin3d.methods import METHODS, CoIn3DOptions, DirectOptions, NoOptions
from coin3d.records import write_json
from coin3d.training.checkpoint import load_checkpoint
from coin3d.training.loop import LOG_FILE
from coin3d.training.options import TrainOptions
from coin3d.training.predict import predict, score_frames
from coin3d.training.run_dir import environment
from coin3d.training.train import RUN_FILE, train
from town_transfer import ROOT, SOURCE, TARGET, gap_closed, gaussians, recording

RESULTS = ROOT / "results" / "three_detectors"
ROWS = {"direct": SOURCE, "coin3d": SOURCE, "oracle": TARGET}
"""Row -> the rig it trains on."""
TITLES = {"direct": "direct transfer", "coin3d": "CoIn3D", "oracle": "oracle"}
BACKBONE_RATE = 0.3
"""The trunk goes on learning, at a share of the rates."""


def method_of(detector: str, row: str) -> tuple[str, Any]:
    """Name and options of a row's method: the detector's own camera-aware gate where it has one, or CoIn3D in full."""
    if row == "coin3d":
        placement = "released" if detector == "bevdepth" else "paper"
        return "coin3d", CoIn3DOptions(placement=placement, novel_views=NovelViewOptions())
    return ("direct", DirectOptions()) if detector == "bevdepth" else ("none", NoOptions())


def trunk(rig: str, work: Path, steps: int, seed: int) -> Path:
    """The trunk of all rows that train on a rig."""
    options = replace(TrainOptions.tiny(), steps=steps, seed=seed)
    return train(
        [recording(work, rig, "train")], work / f"trunk_{rig}_seed{seed}", detector="trunk",
        config=TrunkConfig.of(BEVDepthConfig.tiny()), method="none", method_options=METHODS["none"][0](),
        class_map=MERGED_CAR, options=options,
    )  # fmt: skip


def run_row(detector: str, row: str, work: Path, seed: int, steps: int, trunk_steps: int) -> None:
    """Train and score a row."""
    rig, (method, options) = ROWS[row], method_of(detector, row)
    out = work / f"three_{detector}_{row}_seed{seed}"
    training = replace(TrainOptions.tiny(), steps=steps, seed=seed, backbone_rate=BACKBONE_RATE)
    weights = train(
        [recording(work, rig, "train")], out, detector=detector, config=DETECTORS[detector][0].tiny(), method=method,
        method_options=options, class_map=MERGED_CAR, options=training, trunk=trunk(rig, work, trunk_steps, seed),
        gaussians=gaussians(work) if row == "coin3d" else None,
    )  # fmt: skip
    model, _ = load_checkpoint(weights)
    protocol, rows = Protocol("merged car", classes=MERGED_CAR.classes), []
    for target in (SOURCE, TARGET):
        frames = list(open_recording(recording(work, target, "val")))
        report = score_frames(frames, predict(model, frames), MERGED_CAR, protocol)
        print(f"\n{detector}, {row}, trained on {rig}, scored on {target}\n{report.table()}", flush=True)
        rows.append({"detector": detector, "method": row, "source": rig, "target": target, **report.row()})
    log = [json.loads(line) for line in (out / LOG_FILE).read_text(encoding="utf-8").splitlines()]
    run = json.loads((out / RUN_FILE).read_text(encoding="utf-8"))
    facts = {
        "steps": steps,
        "trunk_steps": trunk_steps,
        "seed": seed,
        "minutes": round(sum(step["seconds"] for step in log) / 60, 1),
        "seconds_per_step_median": round(median(step["seconds"] for step in log), 3),
        **{key: run[key] for key in ("data_fingerprint", "git")},
    }
    write_json(RESULTS / f"{detector}_{row}_seed{seed}.json", {"rows": rows, **facts, **environment()})


def markdown(results: Path = RESULTS) -> str:
    """The table: one line per row and seed. An oracle below mAP 0.35 on its own rig makes its detector's rows uninformative."""
    lines = [
        "| detector | trained as | on | nuScenes-like: mAP | mAOE | NDS* | Waymo-like: mAP | mAOE | NDS* | gap closed |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for detector in DETECTORS:
        for row, rig in ROWS.items():
            for path in sorted(results.glob(f"{detector}_{row}_seed*.json")):
                found = {r["target"]: r for r in json.loads(path.read_text(encoding="utf-8"))["rows"]}
                cells = [f"{found[target][key]:.3f}" for target in (SOURCE, TARGET) for key in ("mAP", "mAOE", "NDS*")]
                lines.append(f"| {detector} | {TITLES[row]} | {rig} | {' | '.join(cells)} | {_closed(path, row, found)} |")
    return "\n".join(lines)


def _closed(path: Path, row: str, found: Any) -> str:
    ends = [path.with_name(path.name.replace(row, end)) for end in ("direct", "oracle")]
    if row != "coin3d" or not all(end.is_file() for end in ends):
        return ""
    direct, oracle = ({r["target"]: r for r in json.loads(end.read_text(encoding="utf-8"))["rows"]} for end in ends)
    return "not informative" if oracle[TARGET]["mAP"] < 0.35 else f"{gap_closed(found, direct, oracle):.0%}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, default=Path("out/town_transfer"), help="where recordings and runs go")
    parser.add_argument("--detectors", nargs="+", choices=[*DETECTORS], default=[*DETECTORS])
    parser.add_argument("--rows", nargs="+", choices=[*ROWS], default=[*ROWS])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=TrainOptions.tiny().steps)
    parser.add_argument("--trunk-steps", type=int, default=TrainOptions.tiny().steps)
    arguments = parser.parse_args()
    for detector in arguments.detectors:
        for row in arguments.rows:
            run_row(detector, row, arguments.work, arguments.seed, arguments.steps, arguments.trunk_steps)


if __name__ == "__main__":
    main()
