"""How far does a detector trained on one rig carry to another? The README's transfer table, from nothing.

    python benchmarks/town_transfer.py --work out/town_transfer

records the town through a nuScenes-like and a Waymo-like rig (same worlds), trains one detector per row at preset
`tiny`, scores each on both rigs, and writes one small JSON per row into results/town_transfer/. Every step is skipped
when its product exists, so an interrupted run continues. `--rows` chooses rows, `--seed` the seed of weights and order.
Each result tells the minutes of its training. `--ship` also stores the weights of the rows
`direct` and `sfm+faug` in half precision in src/coin3d/weights, where `coin3d demo` finds them.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from coin3d.datasets.classes import MERGED_CAR
from coin3d.datasets.open import open_recording
from coin3d.detectors import BEVDepthConfig
from coin3d.evaluation import Protocol
from coin3d.geometry import preset_rig
from coin3d.methods import CoIn3DOptions, DirectOptions
from coin3d.records import write_json
from coin3d.town import record
from coin3d.training.checkpoint import load_checkpoint, save_checkpoint
from coin3d.training.loop import LOG_FILE
from coin3d.training.options import TrainOptions
from coin3d.training.predict import predict, score_frames
from coin3d.training.run_dir import environment, fingerprint
from coin3d.training.train import RUN_FILE, train

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "results" / "town_transfer"
SHIPPED = {"direct": "town-direct", "sfm+faug": "town-coin3d"}
WIDTH_PX = 400
KEY_FRAMES = 10
SEEDS = {"train": range(40), "val": range(1000, 1012)}

ROWS: dict[str, tuple[str, str, Any]] = {
    "direct": ("nuscenes", "direct", DirectOptions()),
    "sfm": ("nuscenes", "coin3d", CoIn3DOptions(focal_augmentation=False)),
    "sfm+faug": ("nuscenes", "coin3d", CoIn3DOptions()),
    "oracle": ("waymo", "direct", DirectOptions()),
}
"""Row -> (rig it is trained on, method, options)."""


TITLES = {"direct": "direct transfer", "sfm": "SFM", "sfm+faug": "SFM + F-Aug", "oracle": "oracle"}


def recording(work: Path, rig: str, split: str) -> Path:
    """The town through a rig, recorded unless it is there."""
    out = work / f"town_{rig}_{split}"
    record(preset_rig(rig, WIDTH_PX), out, seeds=list(SEEDS[split]), key_frames=KEY_FRAMES, sweeps=False, workers=2)
    return out


def run_row(name: str, work: Path, seed: int, steps: int | None) -> Path:
    source, method, options = ROWS[name]
    training = replace(TrainOptions.tiny(), seed=seed)
    if steps is not None:
        training = replace(training, steps=steps)
    data = recording(work, source, "train")
    out = work / f"run_{name}_seed{seed}"
    weights = out / "model.safetensors"
    if not weights.is_file():
        train(
            [data], out, detector="bevdepth", config=BEVDepthConfig.tiny(), method=method, method_options=options,
            class_map=MERGED_CAR, options=training,
        )  # fmt: skip
    # from the run's own files: it may have been trained by an earlier call
    log = (json.loads(line) for line in (out / LOG_FILE).read_text(encoding="utf-8").splitlines())
    minutes = sum(step["seconds"] for step in log) / 60
    trained_at = json.loads((out / RUN_FILE).read_text(encoding="utf-8"))["git"]
    model, _ = load_checkpoint(weights)
    protocol = Protocol("merged car", classes=MERGED_CAR.classes)
    rows = []
    for target in ("nuscenes", "waymo"):
        frames = list(open_recording(recording(work, target, "val")))
        report = score_frames(frames, predict(model, frames), MERGED_CAR, protocol)
        print(f"\n{name}, trained on {source}, scored on {target}\n{report.table()}", flush=True)
        rows.append({"detector": "bevdepth", "method": name, "source": source, "target": target, **report.row()})
    facts = {"steps": training.steps, "seed": seed, "minutes": round(minutes, 1)}
    data_facts = {"train_frames": len(open_recording(data)), "data_fingerprint": fingerprint([data]), "git": trained_at}
    write_json(RESULTS / f"{name}_seed{seed}.json", {"rows": rows, **facts, **data_facts, **environment()})
    return weights


def markdown(results: Path = RESULTS) -> str:
    """The README's table, from the results on disk: one line per row and seed."""
    lines = [
        "| trained as | on | nuScenes-like: mAP | mATE | mAOE | NDS* | Waymo-like: mAP | mATE | mAOE | NDS* |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, (source, _, _) in ROWS.items():
        for path in sorted(results.glob(f"{name}_seed*.json")):
            rows = {row["target"]: row for row in json.loads(path.read_text(encoding="utf-8"))["rows"]}
            cells = [f"{rows[rig][key]:.3f}" for rig in ("nuscenes", "waymo") for key in ("mAP", "mATE", "mAOE", "NDS*")]
            lines.append(f"| {TITLES[name]} | {source} | {' | '.join(cells)} |")
    return "\n".join(lines)


def ship(name: str, weights: Path) -> None:
    """Store a row's weights in half precision where the package finds them."""
    model, description = load_checkpoint(weights)
    save_checkpoint(
        ROOT / "src" / "coin3d" / "weights" / f"{SHIPPED[name]}.safetensors", model.state_dict(), description, half=True
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, default=Path("out/town_transfer"), help="where recordings and runs go")
    parser.add_argument("--rows", nargs="+", choices=[*ROWS], default=[*ROWS])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, help="other than the preset's")
    parser.add_argument("--ship", action="store_true", help="store the weights the demo uses")
    parser.add_argument("--table", action="store_true", help="only print the README's table from the results on disk")
    arguments = parser.parse_args()
    if arguments.table:
        print(markdown())
        return
    for name in arguments.rows:
        weights = run_row(name, arguments.work, arguments.seed, arguments.steps)
        if arguments.ship and name in SHIPPED:
            ship(name, weights)


if __name__ == "__main__":
    main()
