"""``coin3d evaluate``: score a checkpoint, or a results file, on a recording with labels."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional, arg

from coin3d.commands.outcome import finish, spread
from coin3d.commands.protocols import open_target

if TYPE_CHECKING:
    from coin3d.datasets.classes import ClassMap
    from coin3d.datasets.frame import Frame, Recording
    from coin3d.datasets.splits import SplitChoice
    from coin3d.evaluation import BoxTable, Protocol
    from coin3d.evaluation.transfer import TransferProtocol
    from coin3d.inference import LoadedDetector

ClassChoice = Literal["merged-car", "plain-car", "three-class"]


def evaluate(
    checkpoint: Annotated[Positional[str], arg(metavar="CHECKPOINT|RESULTS")],
    recording: Annotated[Positional[Path], arg(metavar="RECORDING")],
    out: Path,
    classes: Annotated[ClassChoice | None, arg(help_behavior_hint="(default: from the checkpoint, or three-class)")] = None,
    range_shape: Literal["radial", "square"] = "radial",
    setting: Annotated[str | None, arg(name="protocol", metavar="NAME", help_behavior_hint="(default: none)")] = None,
    split: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="(default: all scenes)")] = None,
    frames: int = 0,
    breakdown: bool = False,
    intervals: bool = False,
    pictures: int = 6,
    min_score: float = 0.25,
    source: str = "",
    target: str = "",
    precision: Literal["float32", "bfloat16"] = "float32",
    device: str = "auto",
) -> None:
    """Score detections on a recording with labels: AP at 0.5, 1, 2 and 4 m, errors at 2 m, NDS*.

    Of a detector, which is run, or of a results file in the format of the nuScenes detection task, whoever wrote it. The
    protocol is printed with the numbers, and the same numbers without its visibility and LiDAR filters beside them.

    Try:
      coin3d evaluate town-coin3d out/demo/data/waymo --out out/score
      coin3d evaluate runs/mine/model.safetensors data/val --out out/score --breakdown --intervals
      coin3d evaluate runs/mine/model.safetensors data/nuscenes --out out/score --protocol waymo-to-nuscenes
      coin3d evaluate results_nusc.json data/nuscenes --out out/score --classes merged-car

    Args:
        checkpoint: a shipped name, a model.safetensors of coin3d train, or a results file (.json).
        recording: folder of a recording with labels.
        out: folder for the results.
        classes: which names count as which class (docs/datasets.md); by default merged-car for a detector of cars alone,
            three-class for one of all three and for a results file.
        range_shape: radial: distance from the ego origin; square: largest of |x|, |y|.
        setting: a comparison of the paper, which sets split, classes and rules; coin3d protocols prints them.
        split: score these scenes: a split of nuScenes, Lyft or DDAD (val), or a text file with scene names.
        frames: score this many frames, evenly spread; 0 means all.
        breakdown: also by range, camera, length, LiDAR points and visibility (docs/evaluation.md).
        intervals: also 95 % intervals, from scenes drawn at random.
        pictures: draw this many of the frames; 0 means all.
        min_score: draw predictions with at least this score; the metrics use all.
        source: name of the training data in result.json, by default what the checkpoint tells.
        target: name of the recording in result.json, by default its folder's.
        precision: number format of the network; bfloat16 may be faster where the hardware has it.
        device: auto, cpu, cuda, cuda:1 ...
    """
    from coin3d.datasets.splits import coverage
    from coin3d.evaluation import annotated_boxes, score_tables, truth_table
    from coin3d.evaluation.breakdown import breakdowns
    from coin3d.evaluation.intervals import scene_intervals
    from coin3d.report.metric_curves import draw_metric_curves
    from coin3d.report.pictures import frame_pictures, likely

    began = time.monotonic()
    detector = None if checkpoint.lower().endswith(".json") else _load(checkpoint, precision, device)
    rules = _rules(recording, detector, classes, range_shape, setting, split)
    chosen = [rules.labelled[i] for i in spread(len(rules.labelled), frames)]
    if chosen[0].boxes_world is None:
        raise ValueError(f"{recording}: no annotations to score against; coin3d detect needs none")
    if intervals and len({frame.scene for frame in chosen}) < 2:
        raise ValueError("--intervals draws scenes at random, and these frames are of a single one; leave it out")
    scenes = coverage(rules.split, {frame.scene for frame in chosen})
    print(f"{len(chosen)} frames of {scenes}")
    if detector is None:
        found = _detections_of_file(Path(checkpoint), chosen, frames > 0, rules)
    else:
        found = _detections_of_detector(detector, chosen, rules)
    truth, rigs = truth_table(annotated_boxes(chosen, rules.class_map), rules.protocol), {f.token: f.rig for f in chosen}
    report, matches = score_tables(truth, found.table, rigs, rules.protocol)
    print(report.table())
    target = target or recording.resolve().name
    row: dict[str, Any] = {**found.who, "source": source or found.source, "target": target, **report.row()}
    if intervals:
        bounds = scene_intervals(matches, {frame.token: frame.scene for frame in chosen})
        print(bounds.table())
        row["intervals"] = bounds.row()
    if breakdown:
        parts = breakdowns(matches, rigs)
        print("\n".join(part.table() for part in parts))
        row["breakdown"] = {part.name: part.row() for part in parts}
    drawn = [draw_metric_curves(matches, out / "curves.png")]
    for i in spread(len(chosen), pictures):
        frame = chosen[i]
        shown = likely(matches.predictions.boxes_of(frame.token), min_score)
        title = f"{frame.token}   truth and predictions that are scored; predictions with score >= {min_score:g}"
        sheets = frame_pictures(frame, shown, matches.truth.boxes_of(frame.token), title=title)
        drawn += sheets.save(out / "pictures", frame.token)
    result = {
        "checkpoint": found.path,
        "note": found.note,
        "recording": str(recording),
        "protocol": rules.protocol.describe(),
        "comparison": None if rules.paper is None else rules.paper.row(),
        "scenes": scenes,
        "seconds": round(time.monotonic() - began, 2),
        "rows": [row],
    }
    finish(out, result, drawn)


@dataclass(frozen=True)
class _Rules:
    """What is scored, and how."""

    labelled: Recording
    class_map: ClassMap
    protocol: Protocol
    split: SplitChoice | None
    paper: TransferProtocol | None


@dataclass(frozen=True)
class _Detections:
    """Boxes, and whose they are."""

    table: BoxTable
    who: dict[str, str]
    source: str
    path: str
    note: str


def _load(checkpoint: str, precision: Literal["float32", "bfloat16"], device: str) -> LoadedDetector:
    from coin3d.inference import load  # with all of torch, which results files do without

    return load(checkpoint, device, precision=precision)


def _rules(
    recording: Path,
    detector: LoadedDetector | None,
    classes: ClassChoice | None,
    range_shape: Literal["radial", "square"],
    setting: str | None,
    split: str | None,
) -> _Rules:
    from coin3d.datasets.open import open_recording
    from coin3d.evaluation.paper_protocols import paper_protocol
    from coin3d.report.rows import protocol_for

    if setting is None:
        class_map = class_map_for(classes, None if detector is None else detector.classes)
        return _Rules(open_recording(recording, split), class_map, protocol_for(class_map, range_shape), split, None)
    if classes or split or range_shape != "radial":
        raise ValueError(f"--protocol {setting} sets classes, split and range; leave --classes, --split, --range-shape out")
    paper = paper_protocol(setting)
    detected = tuple(paper.scoring_classes.mapping) if detector is None else detector.classes
    labelled = open_target(paper, recording, detected)
    print(paper.describe())
    return _Rules(labelled, paper.scoring_classes, paper.scoring, paper.target.named_split, paper)


def _detections_of_detector(detector: LoadedDetector, chosen: list[Frame], rules: _Rules) -> _Detections:
    from coin3d.evaluation import prediction_table

    print(detector.note)
    found = detector.detect_frames(chosen, print, recording=rules.labelled)
    table = prediction_table({token: rules.class_map.apply(boxes) for token, boxes in found.items()}, rules.protocol)
    who = {name: str(detector.description[name]) for name in ("detector", "method")}
    return _Detections(table, who, detector.source, str(detector.path), detector.note)


def _detections_of_file(path: Path, chosen: list[Frame], part: bool, rules: _Rules) -> _Detections:
    from coin3d.evaluation.results_json import read_results

    table = read_results(path, {frame.token: frame.world_from_ego for frame in chosen}, rules.class_map, skip_others=part)
    note = f"{len(table)} boxes of {len(table.tokens)} samples from {path}"
    if missing := len(chosen) - len(table.tokens):
        note += f"; it says nothing of {missing} samples, in which nothing counts as found"
    print(note)
    return _Detections(table, {"detector": path.stem, "method": ""}, "", str(path), note)


def class_map_for(choice: ClassChoice | None, detected: tuple[str, ...] | None = None) -> ClassMap:
    """The class map of a choice, or the natural one for what a detector knows.

    Raises:
        ValueError: classes the detector was not trained on.
    """
    from coin3d.datasets.classes import MERGED_CAR, PLAIN_CAR, THREE_CLASS

    maps = {"merged-car": MERGED_CAR, "plain-car": PLAIN_CAR, "three-class": THREE_CLASS}
    if choice is None:
        choice = "merged-car" if detected == MERGED_CAR.classes else "three-class"
    found = {maps[choice].mapping.get(name) for name in detected or ()}
    if detected is not None and (missing := [c for c in maps[choice].classes if c not in found]):
        raise ValueError(
            f"--classes {choice} scores {', '.join(missing)}, but this checkpoint only knows {', '.join(detected)}; "
            "choose other classes"
        )
    return maps[choice]
