"""Every table of README and docs/results.md, from the figures in results/.

    python benchmarks/tables.py

writes them anew between their marks, ``<!-- table NAME -->`` and ``<!-- end -->``; a test finds tables that are not up to date.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent))

import three_detectors
import town_transfer

RESULTS = Path(__file__).resolve().parents[1] / "results"


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def figures(name: str) -> Any:
    return json.loads((RESULTS / name).read_text(encoding="utf-8"))


def transfer() -> str:
    """Preset tiny, every row."""
    return town_transfer.markdown()


def transfer_long() -> str:
    """The headline rows with twice the steps."""
    return town_transfer.markdown(suffix="_long")


def transfer_of_detectors() -> str:
    """Direct transfer, CoIn3D and oracle of each detector, from the same image trunks."""
    return three_detectors.markdown()


def training_step() -> str:
    """Seconds of a step at preset tiny."""
    rows = [
        [row["detector"], row["method"], f"{row['seconds_per_step']:.3f}", f"{row['preset_minutes']:.1f}"]
        for row in figures("benchmarks/training_step.json")["rows"]
    ]
    return table(["detector", "method", "seconds per step", "minutes for 1,000 steps"], rows)


def overfit() -> str:
    """Eight frames learned by heart."""
    rows = [
        [row["detector"], row["steps"], row["frames"], f"{row['mAP']:.3f}", f"{row['mATE']:.3f}", f"{row['mAOE']:.3f}"]
        for row in figures("benchmarks/overfit.json")["rows"]
    ]
    return table(["detector", "steps", "frames", "mAP on them", "mATE", "mAOE"], rows)


def latency() -> str:
    """One frame through each detector at the paper's size."""
    rows = [
        [
            row["detector"],
            f"{row['rig']}, {row['cameras']} cameras",
            row["precision"],
            f"{row['seconds']:.2f}",
            f"{row['seconds_sfm']:.2f}",
            f"{row['sfm_adds']:+.1%}",
            f"{row['cold_seconds_sfm']:.2f}",
            f"{row['peak_mb'] / 1e3:.1f} GB",
        ]
        for row in figures("benchmarks/latency.json")["rows"]
    ]
    header = ["detector", "rig", "precision", "seconds", "with SFM", "SFM adds", "first frame of a rig", "peak memory"]
    return table(header, rows)


def pooling() -> str:
    """BEV pooling against the outer product."""
    rows = [
        [
            row["size"],
            f"{row['native_ms']:.1f}",
            f"{row['plain_ms']:.1f}",
            f"{row['ratio']:.1f} times",
            f"{row['native_peak_mb']:.0f} MB",
            f"{row['plain_peak_mb']:.0f} MB",
        ]
        for row in figures("benchmarks/bev_pool.json")["rows"]
    ]
    return table(["size", "native, ms", "outer product, ms", "as fast", "memory native", "memory outer product"], rows)


def check_mistakes() -> str:
    """Mistakes put into sound recordings, and those that are found, in both halves."""
    halves = [figures(f"benchmarks/check_mistakes_{half}.json") for half in ("report", "develop")]
    rows = [
        [name, *(f"{half['rows'][name]['caught']} of {half['rows'][name]['tried']}" for half in halves)]
        for name in halves[0]["rows"]
    ]
    alarms = [f"{sum(map(len, half['false_alarms'].values()))} in {len(half['false_alarms'])}" for half in halves]
    return table(["mistake", "found", "where limits were set"], [*rows, ["*false alarms without a mistake*", *alarms]])


def evaluation() -> str:
    """The detection metric against nuscenes-devkit, and at the size of a validation set."""
    found = figures("benchmarks/evaluate.json")
    small, large = found["against_devkit"], found["large"]
    rows = [
        ["nuscenes-devkit", small, small["seconds_devkit"], "", ""],
        [
            "here, from boxes of samples",
            small,
            small["seconds_from_boxes_of_samples"],
            small["ratio_from_boxes_of_samples"],
            "",
        ],
        ["here, from columns", small, small["seconds"], small["ratio"], ""],
        ["here, from columns", large, large["seconds"], "", large["peak_gib"]],
        ["and with all filters", large, large["seconds_with_filters"], "", large["peak_gib_with_filters"]],
    ]
    cells = [
        [
            what,
            size["samples"],
            f"{size['predicted_boxes']:,}",
            f"{seconds:.2f}",
            ratio and f"{ratio:.0f}x",
            gib and f"{gib:.1f} GiB",
        ]
        for what, size, seconds, ratio, gib in rows
    ]
    return table(["what", "samples", "detections", "seconds", "ratio", "peak memory"], cells)


def reading() -> str:
    """Frames per second with images and LiDAR, real frames and one drive in every format."""
    rows, formats = [], figures("benchmarks/reading_formats.json")["rows"]
    written = [{**row, "recording": f"the Waymo frame as {row['recording']}"} for row in formats]
    for row in [*figures("benchmarks/reading.json")["rows"], *written]:
        width, height = row["image_px"]
        cells = [
            f"{row[key]:.1f}{ending}" if key in row else ""
            for size in ("whole", "input")
            for key, ending in ((size, ""), (f"{size}_plain", ""), (f"{size}_ratio", "x"))
        ]
        rows.append([row["recording"], f"{row['cameras']} of {width} x {height}", f"{row['points']:,}", *cells])
    header = [
        "recording",
        "images",
        "points",
        "whole images",
        "devkit + PIL",
        "ratio",
        "network input",
        "devkit + PIL",
        "ratio",
    ]
    return table(header, rows)


def tables_index() -> str:
    """Making and using the index of tables in nuScenes format, against parsing them whole."""
    rows = []
    for step in figures("benchmarks/index_tables.json")["steps"]:
        rate = f"{step['frames_per_second']:.0f}" if step["frames_per_second"] else ""
        rows.append([step["what"], f"{step['seconds']:.2f}", f"{step['peak_mb']:.0f} MB", rate])
    return table(["step", "seconds", "peak memory", "frames/s"], rows)


def novel_views() -> str:
    """Rendered against true views."""
    rows = [
        [
            setting,
            f"{row['psnr_db']:.1f}",
            f"{row['psnr_covered_db']:.1f}",
            f"{row['ssim']:.3f}",
            f"{row['depth_error']:.2%}",
            f"{row['empty_below_horizon']:.2%}",
        ]
        for setting, row in figures("novel_views.json")["settings"].items()
    ]
    header = ["rendered as", "PSNR, dB", "PSNR of covered pixels, dB", "SSIM", "depth error", "empty below horizon"]
    return table(header, rows)


def mesh_depth() -> str:
    """Depth of meshes and of completed holes against the truth."""
    f = figures("novel_views.json")["depth"]
    rows = [
        ["pixels on meshes", f"{f['mesh_error_median_m']:.3f} m", f"{f['mesh_error_p90_m']:.3f} m"],
        ["completed holes", f"{f['hole_error_median_relative']:.1%}", f"{f['hole_error_p90_relative']:.1%}"],
    ]
    return table(["depth of", "median error", "90 % of errors below"], rows)


def real() -> str:
    """Frames of real recordings."""
    rows = []
    for name, title in (("nuscenes_one_frame", "nuScenes, 1 frame"), ("ddad_three_frames", "DDAD, 3 frames")):
        f = figures("real_views.json")[name]
        empty = list(f["empty_below_horizon"].values())
        later = f"{f['next_frame']['psnr_covered_db_median']:.1f}" if "next_frame" in f else ""
        rows.append([title, f"{median(f['psnr_db']):.1f}", *(f"{share:.1%}" for share in empty), later])
    header = ["recording", "own images, dB", "empty: raw", "full overlap", "height +1 m", "height -1 m", "next frame, dB"]
    return table(header, rows)


def renderer() -> str:
    """Images per second and the ratio to plain torch, both on two threads."""
    found = figures("benchmarks/render.json")["rows"]
    times = {(row["views"], row["renderer"]): row["wall_ms"] for row in found if row["threads"] == 2}
    rows = []
    for views in dict.fromkeys(views for views, _ in times):
        for kind in ("avx512", "avx2", "baseline", "torch"):
            if (views, kind) in times:
                ms = times[views, kind]
                ratio = "" if kind == "torch" else f"{times[views, 'torch'] / ms:.0f} times"
                rows.append([f"{views}-like", kind, f"{ms:.1f}", f"{1e3 / ms:.1f}", ratio])
    return table(["views of the rig", "code", "ms per image", "images/s", "as fast as torch"], rows)


def fusion() -> str:
    """LiDAR fusion."""
    rows = [
        [row["way"], row["threads"], f"{row['million_points_per_s']:.1f}"] for row in figures("benchmarks/tsdf.json")["rows"]
    ]
    return table(["code", "threads", "million points/s"], rows)


def building() -> str:
    """One scene, from files to files."""
    f = figures("benchmarks/build_scene.json")
    header = ["key frames", "cameras", "image width", "processes", "seconds", "peak memory", "per frame on disk"]
    row = [f["key_frames"], f["cameras"], f["width_px"], f["workers"], f"{f['seconds_median']:.0f}"]
    return table(header, [[*row, f"{f['peak_gib']:.1f} GiB", f"{f['megabytes_per_frame']:.1f} MB"]])


TABLES = {
    make.__name__: make
    for make in (
        transfer,
        transfer_long,
        transfer_of_detectors,
        training_step,
        overfit,
        latency,
        pooling,
        check_mistakes,
        evaluation,
        reading,
        tables_index,
        novel_views,
        mesh_depth,
        real,
        renderer,
        fusion,
        building,
    )
}
DOCUMENTS = [RESULTS.parent / "README.md", RESULTS.parent / "docs" / "results.md"]
_PLACE = re.compile(r"<!-- table (\w+) -->\n.*?<!-- end -->", re.DOTALL)


def filled(document: str) -> str:
    """A document with all its tables as measured."""
    return _PLACE.sub(lambda at: f"<!-- table {at[1]} -->\n{TABLES[at[1]]()}\n<!-- end -->", document)


def main() -> None:
    for path in DOCUMENTS:
        path.write_text(filled(path.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
