"""``coin3d rig report``: whether a rig is one that a network knows, as one page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from coin3d.datasets.image_source import read_image
from coin3d.geometry import Rig
from coin3d.records import to_plain, write_bytes, write_json
from coin3d.report.html import figure, page, paragraph, table, text
from coin3d.rig_report.distance_figures import directions_figure, numbers_figure, rows_figure
from coin3d.rig_report.facts import rig_facts
from coin3d.rig_report.figures import figure_png
from coin3d.rig_report.prior_distance import CameraDistance, RigDistance, rig_distance
from coin3d.rig_report.text import rig_table
from coin3d.rig_report.training_views import training_views
from coin3d.rig_report.verdict import Verdict, advice, verdicts
from coin3d.training.seen_rigs import TrainingRigs

REPORT_FILE = "report.html"

_CAPTIONS = {
    "distance_numbers.png": "Every camera against what training had. A camera whose ground depth does not grow from row to row "
    "(one that hangs upside down) has no growth.",
    "distance_ground.png": "Ground depth and its growth (the ground gradient is log(1/growth + 1)/2) down the middle of each "
    "image. Red: outside what training had in that row by more than 5 %. Rows without a line show no ground within 60 m; red dots "
    "at the right edge are such rows where training had ground.",
    "distance_directions.png": "Plücker directions: where training cameras looked, and the network inputs of this rig over it.",
}
_HEADER = (
    "camera", "inverse focal", "focal", "ground depth", "depth", "ground gradient", "growth at 20 m", "ray direction", "up to",
    "ray place", "typical", "nearest yaw",
)  # fmt: skip


@dataclass(frozen=True)
class DistanceReport:
    """What ``write_distance_report`` found.

    Args:
        distance: all numbers.
        verdicts: one per camera.
        advice: what to do.
        pictures: names of the pictures beside the page.
    """

    distance: RigDistance
    verdicts: tuple[Verdict, ...]
    advice: str
    pictures: tuple[str, ...]

    def text(self) -> str:
        """For the terminal."""
        return "\n".join([_question(self.distance), *map(str, self.verdicts), self.advice])


def write_distance_report(
    rig: Rig, training: TrainingRigs, out: Path, *, method: str | None = None, source: str = ""
) -> DistanceReport:
    """Compare a rig with the rigs of a training: report.html, its pictures as PNG, and result.json in ``out``.

    Args:
        rig: of pinhole cameras.
        training: what training showed.
        out: folder, made if need be.
        method: name of the method that the network was trained with, for the advice; None if unknown.
        source: where the training rigs come from, in words, for the page.
    """
    distance, views = rig_distance(rig, training), training_views(training)
    found = verdicts(distance)
    report = DistanceReport(distance, found, advice(found, method), tuple(_CAPTIONS))
    figures = (numbers_figure(distance), rows_figure(rig, distance, views), directions_figure(rig, distance, views))
    for name, drawn in zip(report.pictures, figures, strict=True):
        write_bytes(out / name, figure_png(drawn))
    facts = rig_facts(rig)
    body = [
        *_head(report, training, source),
        *_numbers(distance),
        *(figure(read_image(out / name), caption) for name, caption in _CAPTIONS.items()),
        "<h2>The rig</h2>",
        f"<pre>{text(rig_table(facts))}</pre>",
    ]
    write_bytes(out / REPORT_FILE, page(f"{rig.name}: distance to training", body).encode())
    write_json(
        out / "result.json",
        {
            "rig": to_plain(facts),
            "distance": to_plain(distance),
            "verdicts": to_plain(found),
            "advice": report.advice,
            "report": REPORT_FILE,
            "pictures": list(report.pictures),
        },
    )
    return report


def _question(distance: RigDistance) -> str:
    return f"{distance.rig} against what training showed ({', '.join(distance.trained_on)}):"


def _head(report: DistanceReport, training: TrainingRigs, source: str) -> list[str]:
    width, height = training.size_px
    rows = [[v.name, v.level, " ".join(v.findings)] for v in report.verdicts]
    return [
        f"<h1>{text(report.distance.rig)}: is this a rig the network knows?</h1>",
        paragraph(f"{source + ' ' if source else ''}{_what_was_seen(training)} Network input {width} x {height}.", "lead"),
        paragraph(report.advice, "note"),
        table(("camera", "against training", "what is new"), rows),
        paragraph("The words follow from geometry by fixed limits. No accuracy was measured for them."),
    ]


def _what_was_seen(training: TrainingRigs) -> str:
    names = ", ".join(dict.fromkeys(rig.name for rig in training.rigs))
    count = len(training.rigs)
    parts = [f"Training rigs: {names} ({count} distinct {'rig' if count == 1 else 'rigs'})."]
    if training.focal is not None:
        parts.append(f"Raw images were zoomed by {training.focal.min_ratio:g} to {training.focal.max_ratio:g}.")
    if training.novel_views is not None:
        s = training.novel_views.sampler
        ranges = (
            f"focal length times {s.focal_ratio[0]:g} to {s.focal_ratio[1]:g}, {s.shift_m:g} m in x and y, height "
            f"{s.height_m[0]:g} to {s.height_m[1]:g} m, yaw {s.yaw_deg:g} and tilt {s.tilt_deg:g} degrees to both sides"
            if not s.mounts
            else f"target-aware ranges, height {s.height_m[0]:g} to {s.height_m[1]:g} m"
        )
        array = "; cameras dropped, added, laid out anew" if s.array is not None else ""
        parts.append(
            f"{training.novel_views.probability:.0%} of samples were rendered through rigs drawn at random: {ranges}{array}."
        )
    if training.max_rotation_deg:
        parts.append(f"Images were turned by up to {training.max_rotation_deg:g} degrees.")
    if training.half_turn_probability:
        parts.append(f"{training.half_turn_probability:.0%} of samples of rigs that do not see behind were turned about.")
    return " ".join(parts)


def _numbers(distance: RigDistance) -> list[str]:
    parts = [
        "<h2>The four priors</h2>",
        paragraph(
            "Shares are of image cells whose value training never showed (ground: in the same row of the image). Beside them "
            "the distance to the nearest value it did show: focal length and ground depth as ratios, growth of the ground depth "
            "per image row where the ground is 20 m deep, rays in degrees from the nearest direction in which training looked "
            "and in metres from the nearest parallel ray. How each is defined: src/coin3d/rig_report/prior_distance.py."
        ),
        table(_HEADER, [_row(camera) for camera in distance.shown]),
    ]
    if distance.augmented:
        parts += [
            "<details><summary>Against the recorded cameras alone, without augmentation</summary>",
            table(_HEADER, [_row(camera) for camera in distance.recorded]),
            "</details>",
        ]
    return parts


def _row(c: CameraDistance) -> Sequence[str]:
    depth = "-" if c.depth_ratio is None or c.depth_beyond_m is None else f"x {c.depth_ratio:.2f}, {c.depth_beyond_m:+.1f} m"
    growth = "-" if c.growth_m.ratio is None else f"x {c.growth_m.ratio:.2f}"
    return (
        c.name,
        f"{c.focal_outside:.0%}",
        f"x {c.focal_px.ratio or 1:.2f}",
        f"{c.depth_outside:.0%}",
        depth,
        f"{c.growth_outside:.0%}",
        growth,
        f"{c.direction_outside:.0%}",
        f"{c.direction_deg:.0f}°",
        f"{c.offset_outside:.0%}",
        "-" if c.offset_m is None else f"{c.offset_m:.2f} m",
        f"{c.nearest_yaw_deg:+.0f}°",
    )
