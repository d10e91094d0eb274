"""``coin3d evaluate``: score a checkpoint on a recording with labels."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from coin3d.commands.outcome import finish, spread
from coin3d.commands.protocols import open_target

if TYPE_CHECKING:
    from coin3d.datasets.classes import ClassMap

ClassChoice = Literal["merged-car", "plain-car", "three-class"]


def evaluate(
    checkpoint: Annotated[Positional[str], arg(metavar="CHECKPOINT")],
    recording: Annotated[Positional[Path], arg(metavar="RECORDING")],
    out: Path,
    classes: Annotated[ClassChoice | None, arg(help_behavior_hint="(default: from the checkpoint)")] = None,
    range_shape: Literal["radial", "square"] = "radial",
    setting: Annotated[str | None, arg(name="protocol", metavar="NAME", help_behavior_hint="(default: none)")] = None,
    split: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="(default: all scenes)")] = None,
    frames: int = 0,
    pictures: int = 6,
    min_score: float = 0.25,
    source: str = "",
    target: str = "",
    precision: Literal["float32", "bfloat16"] = "float32",
    device: str = "auto",
) -> None:
    """Score a detector on a recording with labels: AP at 0.5, 1, 2 and 4 m, errors at 2 m, NDS*.

    The protocol is printed with the numbers, and the same numbers without its visibility and LiDAR filters beside them.

    Try:
      coin3d evaluate town-coin3d out/demo/data/waymo --out out/score
      coin3d evaluate runs/mine/model.safetensors data/val --out out/score --range-shape square
      coin3d evaluate runs/mine/model.safetensors data/nuscenes --out out/score --protocol waymo-to-nuscenes

    Args:
        checkpoint: a shipped name, or a model.safetensors of coin3d train.
        recording: folder of a recording in nuScenes format.
        out: folder for the results.
        classes: which names count as which class (docs/datasets.md); by default merged-car for a detector of cars alone,
            three-class for one of all three.
        range_shape: radial: distance from the ego origin; square: largest of |x|, |y|.
        setting: a comparison of the paper, which sets split, classes and rules; coin3d protocols prints them.
        split: score these scenes: a split of nuScenes, Lyft or DDAD (val), or a text file with scene names.
        frames: score this many frames, evenly spread; 0 means all.
        pictures: draw this many of them; 0 means all.
        min_score: draw predictions with at least this score; the metrics use all.
        source: name of the training data in result.json, by default what the checkpoint tells.
        target: name of the recording in result.json, by default its folder's.
        precision: number format of the network; bfloat16 may be faster where the hardware has it.
        device: auto, cpu, cuda, cuda:1 ...
    """
    from coin3d.datasets.open import open_recording
    from coin3d.datasets.splits import coverage
    from coin3d.evaluation import filter_truth
    from coin3d.evaluation.paper_protocols import paper_protocol
    from coin3d.inference import load
    from coin3d.report.pictures import frame_pictures, likely
    from coin3d.report.rows import protocol_for, result_row
    from coin3d.training.predict import score_frames

    detector = load(checkpoint, device, precision=precision)
    if setting is None:
        class_map = class_map_for(classes, detector.classes)
        protocol, paper = protocol_for(class_map, range_shape), None
        labelled = open_recording(recording, split)
    else:
        if classes or split or range_shape != "radial":
            raise ValueError(f"--protocol {setting} sets classes, split and range; leave --classes, --split, --range-shape out")
        paper = paper_protocol(setting)
        class_map, protocol, split = paper.scoring_classes, paper.scoring, paper.target.named_split
        labelled = open_target(paper, recording, detector.classes)
        print(paper.describe())
    chosen = [labelled[i] for i in spread(len(labelled), frames)]
    if chosen[0].boxes_world is None:
        raise ValueError(f"{recording}: no annotations to score against; coin3d detect needs none")
    scenes = coverage(split, {frame.scene for frame in chosen})
    print(f"{detector.note}\n{len(chosen)} frames of {scenes}")
    began = time.monotonic()
    found = detector.detect_frames(chosen, print, recording=labelled)
    report = score_frames(chosen, found, class_map, protocol)
    print(report.table())
    drawn: list[Path] = []
    for i in spread(len(chosen), pictures):
        frame = chosen[i]
        truth = filter_truth(class_map.apply(frame.boxes), frame.rig, protocol) if frame.boxes is not None else None
        shown = likely(found[frame.token], min_score)
        title = f"{frame.token}   truth that is scored; predictions with score >= {min_score:g}"
        drawn += frame_pictures(frame, shown, truth, title=title).save(out / "pictures", frame.token)
    result = {
        "checkpoint": str(detector.path),
        "note": detector.note,
        "recording": str(recording),
        "protocol": protocol.describe(),
        "comparison": None if paper is None else paper.row(),
        "scenes": scenes,
        "seconds": round(time.monotonic() - began, 2),
        "rows": [result_row(detector, report, source or detector.source, target or recording.resolve().name)],
    }
    finish(out, result, drawn)


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
