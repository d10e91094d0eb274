"""``coin3d detect``: boxes on a recording that needs no labels."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional, arg

from coin3d.commands.outcome import finish, spread

if TYPE_CHECKING:
    from coin3d.datasets.frame import Frame
    from coin3d.geometry import Boxes3D

DETECTIONS_FILE = "detections.json"
RESULTS_FILE = "results.json"


def detect(
    checkpoint: Annotated[Positional[str], arg(metavar="CHECKPOINT")],
    recording: Annotated[Positional[Path], arg(metavar="RECORDING")],
    out: Path,
    frames: int = 0,
    pictures: int = 40,
    min_score: float = 0.25,
    results: bool = False,
    gaussians: Path | None = None,
    rerun: bool = False,
    precision: Literal["float32", "bfloat16"] = "float32",
    device: str = "auto",
) -> None:
    """Find objects in a recording: your own images beside a rig.yaml, or nuScenes-format tables. Labels are not needed.

    Writes detections.json (all boxes, in metres and radians) and, per frame, all images with boxes and a top view.

    The shipped weights (town-coin3d, town-direct) know only the town, a synthetic street world. Weights for real streets
    come by converting released checkpoints (coin3d convert) or by training on your own recordings.

    Try:
      coin3d detect town-coin3d out/demo/data/waymo --out out/boxes
      coin3d detect runs/mine/model.safetensors recordings/van --out out/van --frames 20

    Args:
        checkpoint: a shipped name, or a model.safetensors of coin3d train.
        recording: folder with rig.yaml and images (docs/your_rig.md), or with nuScenes-format tables.
        out: folder for the results.
        frames: look at this many frames, evenly spread; 0 means all.
        pictures: draw this many of them, evenly spread; 0 means all.
        min_score: draw boxes with at least this score; detections.json has all of them.
        results: also write results.json, the same boxes in the format of the nuScenes detection task.
        gaussians: folder that build-scenes wrote for this recording: boxes are drawn on the point cloud as well.
        rerun: also write frames.rrd with the frames that are drawn, for the Rerun viewer.
        precision: number format of the network; bfloat16 may be faster where the hardware has it.
        device: auto, cpu, cuda, cuda:1 ...
    """
    from contextlib import ExitStack

    from coin3d.datasets.open import open_recording
    from coin3d.drawing.sheet import save_png
    from coin3d.evaluation.results_json import write_results
    from coin3d.inference import load
    from coin3d.records import write_json
    from coin3d.rendering.gaussian_folder import GaussianFolder
    from coin3d.report.overview import overview
    from coin3d.report.pictures import file_name, frame_pictures, likely
    from coin3d.report.rerun_file import RerunFile

    detector = load(checkpoint, device, precision=precision)
    clouds = GaussianFolder.open(gaussians) if gaussians is not None else None
    source = open_recording(recording)
    chosen = [source[i] for i in spread(len(source), frames)]
    print(detector.note)
    began = time.monotonic()
    found = detector.detect_frames(chosen, print, recording=source)
    seconds = time.monotonic() - began
    write_json(out / DETECTIONS_FILE, _detections(chosen, found, detector.note))
    if results:
        write_results(out / RESULTS_FILE, ((frame.token, frame.world_from_ego, found[frame.token]) for frame in chosen))
    drawn: list[Path] = []
    with ExitStack() as files:
        viewer = files.enter_context(RerunFile(out / "frames.rrd")) if rerun else None
        for i in spread(len(chosen), pictures):
            frame = chosen[i]
            shown = likely(found[frame.token], min_score)
            title = f"{frame.token}   {len(shown)} boxes with score >= {min_score:g}, of {len(found[frame.token])}"
            drawn += frame_pictures(frame, shown, title=title).save(out / "pictures", frame.token)
            cloud = clouds.load(frame.scene, frame.token) if clouds else None
            if cloud is not None:
                on_cloud = overview(cloud, {str(detector.description["method"]): shown}, title=title)
                drawn.append(save_png(on_cloud, out / "pictures" / f"{file_name(frame.token)}_cloud.png"))
            if viewer:
                viewer.log(frame.rig, {name: frame.image(name) for name in frame.rig}, cloud, predictions=shown)
    total = sum(map(len, found.values()))
    likely_total = sum(len(likely(boxes, min_score)) for boxes in found.values())
    print(f"{len(chosen)} frames in {seconds:.1f} s: {total} boxes, {likely_total} of them with score >= {min_score:g}")
    print(f"boxes:   {out / DETECTIONS_FILE}" + (f" and {out / RESULTS_FILE}" if results else ""))
    result = {
        "checkpoint": str(detector.path),
        "detector": detector.description["detector"],
        "method": detector.description["method"],
        "note": detector.note,
        "recording": str(recording),
        "frames": len(chosen),
        "boxes": total,
        "boxes_drawn_from_score": min_score,
        "boxes_with_that_score": likely_total,
        "seconds": round(seconds, 2),
        "detections": str(out / DETECTIONS_FILE),
    }
    finish(out, result, drawn)


def _detections(frames: list[Frame], found: dict[str, Boxes3D], note: str) -> dict[str, Any]:
    return {
        "note": note,
        "conventions": "ego frame: x forward, y left, z up, metres; centre of gravity; size is length, width, height; "
        "yaw about +z from +x, radians; 'vehicle' is your own frame where rig.yaml has ego_from_vehicle",
        "frames": [_frame(frame, found[frame.token]) for frame in frames],
    }


def _frame(frame: Frame, boxes: Boxes3D) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "token": frame.token, "scene": frame.scene, "timestamp_ns": frame.timestamp_ns, "boxes": _rows(boxes)
    }  # fmt: skip
    if not (frame.rig.ego_from_vehicle.matrix == _identity()).all():
        entry["boxes_vehicle"] = _rows(boxes.transformed(frame.rig.ego_from_vehicle.inverse()))
    return entry


def _identity() -> Any:
    from coin3d.geometry import Pose

    return Pose.identity().matrix


def _rows(boxes: Boxes3D) -> list[dict[str, Any]]:
    return [
        {
            "label": str(boxes.labels[i]),
            "score": round(float(boxes.scores[i]), 4),
            "centre_m": [round(float(x), 3) for x in boxes.centre_m[i]],
            "size_m": [round(float(x), 3) for x in boxes.size_m[i]],
            "yaw_rad": round(float(boxes.yaw_rad[i]), 4),
        }
        for i in range(len(boxes))
    ]
