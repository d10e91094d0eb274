"""Can each detector learn eight frames by heart? What cannot is broken, whatever its losses say.

    python benchmarks/overfit.py --work out/overfit

records eight frames of the town, trains every detector on nothing else at preset `tiny`, and scores it on the same frames
(mAP of the merged car within 50 m; above 0.9 is asked for). Rows go to results/benchmarks/overfit.json.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from coin3d.datasets.classes import MERGED_CAR
from coin3d.datasets.open import open_recording
from coin3d.detectors import DETECTORS
from coin3d.evaluation import Protocol
from coin3d.geometry import preset_rig
from coin3d.methods import CoIn3DOptions
from coin3d.records import write_json
from coin3d.town import record
from coin3d.training.checkpoint import load_checkpoint
from coin3d.training.options import TrainOptions
from coin3d.training.predict import predict, score_frames
from coin3d.training.run_dir import environment
from coin3d.training.train import train

ROOT = Path(__file__).resolve().parents[1]
WORLDS, KEY_FRAMES, WIDTH_PX = range(4), 2, 400
STEPS = {"bevdepth": 400, "bevformer": 400, "petr": 1000}
"""PETR's boxes start without sizes, and its attention has to be learned from nothing."""

RESULT = ROOT / "results" / "benchmarks" / "overfit.json"
OPTIONS = CoIn3DOptions(placement="paper", focal_augmentation=False)


def learn_by_heart(detector: str, work: Path, steps: int) -> dict[str, Any]:
    """Train a detector on the frames and score it on them."""
    data = record(preset_rig("nuscenes", WIDTH_PX), work / "town", seeds=list(WORLDS), key_frames=KEY_FRAMES, workers=2)
    tiny = TrainOptions.tiny()
    training = replace(tiny, steps=steps, augment=replace(tiny.augment, cameras_per_sample=0), batch_size=2)
    weights = train(
        [data], work / f"{detector}_{steps}", detector=detector, config=DETECTORS[detector][0].tiny(), method="coin3d",
        method_options=OPTIONS, class_map=MERGED_CAR, options=training,
    )  # fmt: skip
    model, _ = load_checkpoint(weights)
    frames = list(open_recording(data))
    report = score_frames(frames, predict(model, frames), MERGED_CAR, Protocol("merged car", classes=MERGED_CAR.classes))
    print(f"{detector} after {steps} steps on {len(frames)} frames\n{report.table()}", flush=True)
    return {"detector": detector, "steps": steps, "frames": len(frames), **report.row()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, default=Path("out/overfit"))
    parser.add_argument("--detectors", nargs="+", choices=[*DETECTORS], default=[*DETECTORS])
    parser.add_argument("--steps", type=int, help="for all of them; by default 400, PETR 1,000")
    arguments = parser.parse_args()
    before = json.loads(RESULT.read_text(encoding="utf-8"))["rows"] if RESULT.is_file() else []
    rows = {row["detector"]: row for row in before}
    for name in arguments.detectors:
        rows[name] = learn_by_heart(name, arguments.work, arguments.steps or STEPS[name])
        write_json(RESULT, {"rows": [rows[n] for n in DETECTORS if n in rows], **environment()})


if __name__ == "__main__":
    main()
