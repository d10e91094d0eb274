"""How far does a detector trained on one rig carry to another? The README's transfer table, from nothing.

    python benchmarks/town_transfer.py --work out/town_transfer           # every row at the budget of preset tiny
    python benchmarks/town_transfer.py --work out/town_transfer --long    # the three headline rows, twice as long

records the town through a nuScenes-like and a Waymo-like rig (same worlds), builds the Gaussians of the training frames for
the rows with novel views, trains one detector per row at preset `tiny`, scores each on both rigs, and writes one small JSON
per row into results/town_transfer/. Every step is skipped when its product exists, so an interrupted run continues. `--rows`
chooses rows, `--seed` the seed of weights and order. Each result tells the minutes of its training and how long a step
waited for data. `--ship` also stores weights in half precision in src/coin3d/weights, where `coin3d demo` finds them.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

from coin3d.augmentation import NovelViewOptions
from coin3d.datasets.classes import MERGED_CAR
from coin3d.datasets.open import open_recording
from coin3d.detectors import BEVDepthConfig
from coin3d.evaluation import Protocol
from coin3d.geometry import preset_rig
from coin3d.methods import CoIn3DOptions, DirectOptions
from coin3d.records import write_json
from coin3d.scenes.build import build_scenes
from coin3d.scenes.options import BuildOptions
from coin3d.town import record
from coin3d.training.checkpoint import load_checkpoint, save_checkpoint
from coin3d.training.loop import LOG_FILE
from coin3d.training.options import TrainOptions
from coin3d.training.predict import predict, score_frames
from coin3d.training.run_dir import environment
from coin3d.training.train import RUN_FILE, train

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "results" / "town_transfer"
SHIPPED = {"direct": "town-direct", "sfm+cda": "town-coin3d"}
WIDTH_PX = 400
KEY_FRAMES = 10
SEEDS = {"train": range(40), "val": range(1000, 1012)}
SOURCE, TARGET = "nuscenes", "waymo"


@dataclass(frozen=True)
class Row:
    """How a detector is trained: its name in tables, the rig, the method."""

    title: str
    source: str
    method: str
    options: DirectOptions | CoIn3DOptions

    @property
    def novel_views(self) -> bool:
        return self.options.novel_views is not None


ROWS = {
    "direct": Row("direct transfer", SOURCE, "direct", DirectOptions()),
    "cda+se": Row("CDA + camera-aware SE", SOURCE, "direct", DirectOptions(NovelViewOptions())),
    "sfm": Row("SFM", SOURCE, "coin3d", CoIn3DOptions(focal_augmentation=False)),
    "sfm+faug": Row("SFM + F-Aug", SOURCE, "coin3d", CoIn3DOptions()),
    "sfm+cda": Row("SFM + CDA", SOURCE, "coin3d", CoIn3DOptions(novel_views=NovelViewOptions())),
    "oracle": Row("oracle", TARGET, "direct", DirectOptions()),
}
LONG_ROWS = ("direct", "sfm+cda", "oracle")
LONG_STEPS = 2 * TrainOptions.tiny().steps


def recording(work: Path, rig: str, split: str) -> Path:
    """The town through a rig, recorded unless it is there. LiDAR sweeps only where Gaussians are built from them."""
    sweeps = (rig, split) == (SOURCE, "train")
    out = work / f"town_{rig}_{split}"
    record(preset_rig(rig, WIDTH_PX), out, seeds=list(SEEDS[split]), key_frames=KEY_FRAMES, sweeps=sweeps, workers=2)
    return out


def gaussians(work: Path) -> Path:
    """The Gaussians of the training frames, built unless they are there."""
    out = work / f"gaussians_{SOURCE}_train"
    build_scenes(open_recording(recording(work, SOURCE, "train")), out, BuildOptions(width_px=WIDTH_PX), workers=2)
    return out


def run_row(name: str, work: Path, seed: int, steps: int | None, suffix: str = "") -> Path:
    """Train and score a row; returns its weights."""
    row = ROWS[name]
    training = replace(TrainOptions.tiny(), seed=seed)
    if steps is not None:
        training = replace(training, steps=steps)
    data = recording(work, row.source, "train")
    out = work / f"run_{name}{suffix}_seed{seed}"
    weights = out / "model.safetensors"
    if not weights.is_file():
        train(
            [data], out, detector="bevdepth", config=BEVDepthConfig.tiny(), method=row.method, method_options=row.options,
            class_map=MERGED_CAR, options=training, gaussians=gaussians(work) if row.novel_views else None,
        )  # fmt: skip
    # from the run's own files: it may have been trained by an earlier call
    log = [json.loads(line) for line in (out / LOG_FILE).read_text(encoding="utf-8").splitlines()]
    run = json.loads((out / RUN_FILE).read_text(encoding="utf-8"))
    model, _ = load_checkpoint(weights)
    protocol = Protocol("merged car", classes=MERGED_CAR.classes)
    rows = []
    for target in (SOURCE, TARGET):
        frames = list(open_recording(recording(work, target, "val")))
        report = score_frames(frames, predict(model, frames), MERGED_CAR, protocol)
        print(f"\n{name}, trained on {row.source}, scored on {target}\n{report.table()}", flush=True)
        rows.append({"detector": "bevdepth", "method": name, "source": row.source, "target": target, **report.row()})
    facts = {
        "steps": training.steps,
        "seed": seed,
        "minutes": round(sum(step["seconds"] for step in log) / 60, 1),
        "seconds_per_step_median": round(median(step["seconds"] for step in log), 3),
        "data_wait_seconds_per_step_mean": round(sum(step["data_seconds"] for step in log) / len(log), 4),
    }
    data_facts = {"train_frames": len(open_recording(data)), **{key: run[key] for key in ("data_fingerprint", "git")}}
    write_json(RESULTS / f"{name}{suffix}_seed{seed}.json", {"rows": rows, **facts, **data_facts, **environment()})
    return weights


def markdown(results: Path = RESULTS, suffix: str = "") -> str:
    """A table of README, from the results on disk: one line per row and seed, and the share of the gap that is closed."""
    lines = [
        "| trained as | on | nuScenes-like: mAP | mATE | mAOE | NDS* | Waymo-like: mAP | mATE | mAOE | NDS* | gap closed |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, row in ROWS.items():
        for path in sorted(results.glob(f"{name}{suffix}_seed*.json")):
            scores = _scores(path)
            cells = [f"{scores[rig][key]:.3f}" for rig in (SOURCE, TARGET) for key in ("mAP", "mATE", "mAOE", "NDS*")]
            ends = [path.with_name(path.name.replace(name, end, 1)) for end in ("direct", "oracle")]
            closed = "" if name in ("direct", "oracle") else f"{gap_closed(scores, *map(_scores, ends)):.0%}"
            lines.append(f"| {row.title} | {row.source} | {' | '.join(cells)} | {closed} |")
    return "\n".join(lines)


def gap_closed(scores: Any, direct: Any, oracle: Any) -> float:
    """Share of the gap in NDS* between direct transfer and the oracle, both on the target rig, that a row closes."""
    low, high = direct[TARGET]["NDS*"], oracle[TARGET]["NDS*"]
    return float((scores[TARGET]["NDS*"] - low) / (high - low))


def _scores(path: Path) -> dict[str, Any]:
    return {row["target"]: row for row in json.loads(path.read_text(encoding="utf-8"))["rows"]}


def ship(name: str, weights: Path) -> None:
    """Store a row's weights in half precision where the package finds them."""
    model, description = load_checkpoint(weights)
    save_checkpoint(
        ROOT / "src" / "coin3d" / "weights" / f"{SHIPPED[name]}.safetensors", model.state_dict(), description, half=True
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, default=Path("out/town_transfer"), help="where recordings and runs go")
    parser.add_argument("--rows", nargs="+", choices=[*ROWS], help="default: all, or the headline rows with --long")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, help="other than the preset's")
    parser.add_argument("--long", action="store_true", help=f"{LONG_STEPS} steps, results marked so")
    parser.add_argument("--ship", action="store_true", help="store the weights the demo uses")
    arguments = parser.parse_args()
    suffix, steps = ("_long", LONG_STEPS) if arguments.long else ("", arguments.steps)
    for name in arguments.rows or (LONG_ROWS if arguments.long else ROWS):
        weights = run_row(name, arguments.work, arguments.seed, steps, suffix)
        if arguments.ship and name in SHIPPED:
            ship(name, weights)


if __name__ == "__main__":
    main()
