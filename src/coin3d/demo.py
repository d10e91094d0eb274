"""The demo: record the same worlds through two rigs, run the shipped detectors on both, render one world anew, report."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from coin3d.datasets.classes import MERGED_CAR
from coin3d.datasets.frame import Frame
from coin3d.datasets.nuscenes_format import NuScenesRecording
from coin3d.demo_views import novel_view_pictures
from coin3d.evaluation import Report, filter_truth
from coin3d.geometry import Boxes3D, preset_rig
from coin3d.inference import SHIPPED, TOWN_ONLY, LoadedDetector, load
from coin3d.records import write_bytes
from coin3d.report.demo_page import DemoPage, Shown, demo_page
from coin3d.report.pictures import frame_pictures, likely
from coin3d.report.rows import protocol_for, result_row, rows_table
from coin3d.rig_report import compare_rigs
from coin3d.town import record
from coin3d.training.predict import score_frames

SOURCE_RIG = "nuscenes"
TARGET_RIG = "waymo"
FIRST_SEED = 10_000
"""Worlds from here on are the demo's; training and validation recordings must use smaller seeds."""


@dataclass(frozen=True)
class DemoOptions:
    """How large the demo is; the defaults end within minutes on two cores.

    Args:
        worlds: number of worlds, one scene each.
        key_frames: frames per scene, 0.5 s apart.
        width_px: width of all images.
        shown: frames per rig in the report.
        min_score: predictions below are scored but not drawn.
        checkpoints: shipped names or paths.
        workers: recording processes; 0 takes one per core.
        device: where the detectors run.
    """

    worlds: int = 6
    key_frames: int = 4
    width_px: int = 400
    shown: int = 2
    min_score: float = 0.25
    checkpoints: tuple[str, ...] = SHIPPED
    workers: int = 0
    device: str = "auto"


@dataclass(frozen=True, eq=False)
class DemoOutcome:
    """What came out.

    Args:
        rows: one per detector and rig.
        protocol: what the numbers mean.
        report: the HTML file.
        pictures: all pictures, also as files.
        seconds: of recording and of detecting, by name.
    """

    rows: list[dict[str, Any]]
    protocol: str
    report: Path
    pictures: list[Path]
    seconds: dict[str, float]

    def result(self) -> dict[str, Any]:
        """The content of result.json."""
        return {
            "note": TOWN_ONLY,
            "protocol": self.protocol,
            "rows": self.rows,
            "report": str(self.report),
            "seconds": self.seconds,
        }


@dataclass
class _Tally:
    """Grows as the demo goes along."""

    out: Path
    rows: list[dict[str, Any]] = field(default_factory=list)
    reports: list[tuple[str, str, Report]] = field(default_factory=list)
    pictures: list[Path] = field(default_factory=list)
    shown: list[Shown] = field(default_factory=list)
    found_on_target: dict[str, dict[str, Boxes3D]] = field(default_factory=dict)


def run_demo(out: Path, options: DemoOptions, progress: Callable[[str], None] = print) -> DemoOutcome:
    """Run the demo into ``out``; recordings that are there already are used again.

    Raises:
        FileNotFoundError: a checkpoint is missing.
        ValueError: ``out`` holds recordings made with other options.
    """
    detectors = [load(checkpoint, options.device) for checkpoint in options.checkpoints]  # before minutes of recording
    names = _names(detectors)
    protocol = protocol_for(MERGED_CAR)
    tally = _Tally(out)
    seconds: dict[str, float] = {}
    progress(TOWN_ONLY)
    for rig in (SOURCE_RIG, TARGET_RIG):
        began = time.monotonic()
        progress(f"recording {options.worlds} worlds through the {rig} rig")
        frames = _record(rig, out / "data" / rig, options, progress)
        seconds[f"record {rig}"] = round(time.monotonic() - began, 1)
        for detector, name in zip(detectors, names, strict=True):
            began = time.monotonic()
            progress(f"{name} on the {rig} rig")
            found = detector.detect_frames(frames, progress)
            report = score_frames(frames, found, MERGED_CAR, protocol)
            seconds[f"detect {name} on {rig}"] = round(time.monotonic() - began, 1)
            tally.rows.append(result_row(detector, report, f"town-{SOURCE_RIG}", f"town-{rig}"))
            tally.reports.append((name, rig, report))
            _draw(tally, rig, name, frames, found, report, options)
            if rig == TARGET_RIG:
                tally.found_on_target[name] = {token: likely(boxes, options.min_score) for token, boxes in found.items()}
    began = time.monotonic()
    novel_views = novel_view_pictures(
        _record_sweeps(out / "data" / f"{SOURCE_RIG}_sweeps", options, progress),
        frames,
        tally.found_on_target,
        lambda frame: _scored_truth(frame, report),
        out,
        width_px=options.width_px,
        workers=_workers(options),
        progress=progress,
    )
    tally.pictures += [novel_views.settings, novel_views.compared, novel_views.overview]
    seconds["novel views"] = round(time.monotonic() - began, 1)
    source, target = (preset_rig(name, options.width_px) for name in (SOURCE_RIG, TARGET_RIG))
    difference = compare_rigs(source, target, out / "rigs")
    progress("\n" + rows_table(tally.rows))
    progress(f"{len(frames)} frames per rig. {protocol.describe()}")
    page = DemoPage(
        rows=tally.rows,
        reports=tally.reports,
        frames_per_rig=len(frames),
        worlds=options.worlds,
        min_score=options.min_score,
        shown=tally.shown,
        novel_views=novel_views,
        prior_maps=out / "rigs" / "prior_maps.png",
        top_views=out / "rigs" / "top_view.png",
        difference=difference,
        detectors=[_about(detector) for detector in detectors],
        seconds=seconds,
    )
    write_bytes(out / "report.html", demo_page(page).encode())
    return DemoOutcome(tally.rows, protocol.describe(), out / "report.html", tally.pictures, seconds)


def _record(rig: str, folder: Path, options: DemoOptions, progress: Callable[[str], None]) -> list[Frame]:
    seeds = range(FIRST_SEED, FIRST_SEED + options.worlds)
    camera_rig = preset_rig(rig, options.width_px)
    record(camera_rig, folder, seeds, key_frames=options.key_frames, workers=_workers(options), progress=progress)
    return list(NuScenesRecording(folder))


def _record_sweeps(folder: Path, options: DemoOptions, progress: Callable[[str], None]) -> Path:
    """The first world once more through the source rig, with all LiDAR sweeps: Gaussians are built from it."""
    progress(f"rebuilding one world as Gaussians from the {SOURCE_RIG} rig")
    rig = preset_rig(SOURCE_RIG, options.width_px)
    return record(rig, folder, [FIRST_SEED], key_frames=options.key_frames, sweeps=True, progress=progress)


def _workers(options: DemoOptions) -> int:
    return options.workers or os.cpu_count() or 1


def _scored_truth(frame: Frame, report: Report) -> Boxes3D:
    assert frame.boxes is not None
    return filter_truth(MERGED_CAR.apply(frame.boxes), frame.rig, report.protocol)


def _draw(
    tally: _Tally,
    rig: str,
    name: str,
    frames: list[Frame],
    found: dict[str, Boxes3D],
    report: Report,
    options: DemoOptions,
) -> None:
    for place in range(options.shown):
        # the middle of each of as many parts
        frame = frames[(2 * place + 1) * len(frames) // (2 * options.shown)]
        truth = _scored_truth(frame, report)
        predictions = likely(found[frame.token], options.min_score)
        title = f"{name} on the {rig} rig, {frame.scene}"
        pictures = frame_pictures(frame, predictions, truth, title=title, width_px=1500)
        tally.shown.append(Shown(rig, name, place, pictures))
        tally.pictures += pictures.save(tally.out / "pictures", f"{rig}_{name.replace(' ', '_')}_{place}")


def _names(detectors: list[LoadedDetector]) -> list[str]:
    """The shortest names that tell the detectors apart.

    Raises:
        ValueError: the same checkpoint twice, or one that does not know cars.
    """
    for detector in detectors:
        if not set(MERGED_CAR.classes) <= set(detector.classes):
            raise ValueError(f"{detector.path}: the demo scores cars, this checkpoint knows {', '.join(detector.classes)}")
    about = [detector.description for detector in detectors]
    for names in (
        [str(d["method"]) for d in about],
        [f"{d['detector']} {d['method']}" for d in about],
        [f"{d['detector']} {d['method']} {detector.path.parent.name}" for d, detector in zip(about, detectors, strict=True)],
    ):
        if len(set(names)) == len(names):
            return names
    raise ValueError("the demo compares checkpoints of different detectors, methods or folders; two of these are alike")


def _about(detector: LoadedDetector) -> str:
    d = detector.description
    notes = d.get("notes") or "nothing is written about its training"
    trained_with = {"focal_augmentation": ", focal augmentation", "novel_views": ", novel views"}
    augmented = "".join(words for option, words in trained_with.items() if d["options"].get(option))
    return f"{detector.path.name}: {d['detector']}, method {d['method']}{augmented}, classes {', '.join(d['classes'])}; {notes}"
