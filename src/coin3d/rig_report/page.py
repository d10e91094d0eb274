"""``coin3d rig report``: a rig on one page, and whether it is one that a network knows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from coin3d.datasets.image_source import read_image
from coin3d.geometry import Rig
from coin3d.geometry.undistort import undistorted_rig
from coin3d.records import to_plain, write_bytes, write_json
from coin3d.report.html import figure, page, paragraph, table, text
from coin3d.rig_report.coverage import Coverage, coverage, coverage_figure
from coin3d.rig_report.distance_figures import directions_figure, numbers_figure, rows_figure
from coin3d.rig_report.distance_table import distance_parts
from coin3d.rig_report.facts import RigFacts, rig_facts
from coin3d.rig_report.figures import figure_png, top_view_figure
from coin3d.rig_report.map_figure import prior_maps_figure
from coin3d.rig_report.prior_distance import RigDistance, rig_distance
from coin3d.rig_report.text import rig_table
from coin3d.rig_report.training_views import training_views
from coin3d.rig_report.verdict import Verdict, advice, verdicts
from coin3d.training.seen_rigs import TrainingRigs

REPORT_FILE = "report.html"


@dataclass(frozen=True)
class Comparison:
    """A rig against those of a training.

    Args:
        distance: all numbers.
        verdicts: one per camera.
        advice: what to do.
    """

    distance: RigDistance
    verdicts: tuple[Verdict, ...]
    advice: str

    def text(self) -> str:
        """For the terminal."""
        what = f"{self.distance.rig} against what training showed ({', '.join(self.distance.trained_on)}):"
        return "\n".join([what, *map(str, self.verdicts), self.advice])


@dataclass(frozen=True)
class RigReport:
    """What ``write_rig_report`` found.

    Args:
        facts: of the rig.
        coverage: of its cameras together.
        comparison: None without training rigs.
        pictures: names of the pictures beside the page.
    """

    facts: RigFacts
    coverage: tuple[Coverage, ...]
    comparison: Comparison | None
    pictures: tuple[str, ...]


@dataclass(frozen=True)
class _Picture:
    """A picture of the page: its file, how it is made, and what it shows."""

    name: str
    draw: Callable[[], Figure]
    caption: str


def write_rig_report(
    rig: Rig, out: Path, training: TrainingRigs | None = None, *, method: str | None = None, source: str = ""
) -> RigReport:
    """A rig, and its distance to the rigs of a training: report.html, its pictures as PNG, and result.json in ``out``.

    Args:
        rig: pinhole cameras stand in for those with lenses.
        out: folder, made if need be.
        training: what training showed; None: the page is about the rig alone.
        method: name of the method that the network was trained with, for the advice; None if unknown.
        source: where the training rigs come from, in words, for the page.
    """
    rig = undistorted_rig(rig)
    facts, covered = rig_facts(rig), coverage(rig)
    comparison, pictures = None, []
    if training is not None:
        distance = rig_distance(rig, training)
        found = verdicts(distance)
        comparison = Comparison(distance, found, advice(found, method))
        pictures = _distance_pictures(rig, distance, training)
    about_rig = _rig_pictures(rig)
    for picture in [*pictures, *about_rig]:
        write_bytes(out / picture.name, figure_png(picture.draw()))
    report = RigReport(facts, covered, comparison, tuple(p.name for p in [*pictures, *about_rig]))
    body = [f"<h1>{text(rig.name)}{'' if training is None else ': is this a rig the network knows?'}</h1>"]
    if comparison is not None and training is not None:
        body += distance_parts(comparison.distance, comparison.verdicts, comparison.advice, training, source)
    body += _shown(out, pictures)
    body += ["<h2>The rig</h2>", f"<pre>{text(rig_table(facts))}</pre>", *_coverage_table(covered), *_shown(out, about_rig)]
    write_bytes(out / REPORT_FILE, page(f"{rig.name}: rig report", body).encode())
    write_json(out / "result.json", {**to_plain(report), "rig": rig.name, "report": REPORT_FILE})
    return report


def _distance_pictures(rig: Rig, distance: RigDistance, training: TrainingRigs) -> list[_Picture]:
    views = training_views(training)
    return [
        _Picture(
            "distance_numbers.png",
            lambda: numbers_figure(distance),
            "Every camera against what training had. A camera whose ground depth does not grow from row to row (one that hangs "
            "upside down) has no growth.",
        ),
        _Picture(
            "distance_ground.png",
            lambda: rows_figure(rig, distance, views),
            "Ground depth and its growth (the ground gradient is log(1/growth + 1)/2) down the middle of each image. Red: "
            "outside what training had in that row by more than 5 %. Rows without a line show no ground within 60 m; red dots "
            "at the right edge are such rows where training had ground.",
        ),
        _Picture(
            "distance_directions.png",
            lambda: directions_figure(rig, distance, views),
            "Plücker directions: where training cameras looked, and the network inputs of this rig over it.",
        ),
    ]


def _rig_pictures(rig: Rig) -> list[_Picture]:
    return [
        _Picture("top_view.png", lambda: top_view_figure([rig]), "Where the cameras sit and look."),
        _Picture(
            "coverage.png",
            lambda: coverage_figure(rig),
            "What they cover together, from above; rings at 5, 10, 20, 30, 40 and 50 m. Nothing stands in the way.",
        ),
        _Picture("prior_maps.png", lambda: prior_maps_figure([rig]), "The prior maps of every camera (docs/method.md)."),
    ]


def _shown(out: Path, pictures: Sequence[_Picture]) -> list[str]:
    return [figure(read_image(out / picture.name), picture.caption) for picture in pictures]


def _coverage_table(covered: Sequence[Coverage]) -> list[str]:
    rows = []
    for c in covered:
        least, median = ("-", "-") if c.pixels_per_metre is None else (f"{n:.0f}" for n in c.pixels_per_metre)
        angles = (f"{c.seen_deg:.0f}°", f"{360 - c.seen_deg:.0f}°", f"{c.overlapping_deg:.0f}°")
        rows.append((f"{c.distance_m:g} m", *angles, median, least))
    header = ("distance", "seen", "blind", "seen twice", "pixels per metre, median", "least")
    return [paragraph("Around the ego origin, 1 m above the ground, in recorded images:"), table(header, rows)]
