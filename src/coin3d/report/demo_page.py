"""The report of the demo: what was asked, the numbers with their protocol, pictures, what the weights know."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from coin3d.datasets.image_source import read_image
from coin3d.drawing.colours import PREDICTION, RGB, TRUTH
from coin3d.evaluation import Report
from coin3d.inference import TOWN_ONLY
from coin3d.report.html import figure, page, paragraph, table, text
from coin3d.report.pictures import FramePictures

TITLE = "CoIn3D demo: one detector, two camera rigs"


@dataclass(frozen=True, eq=False)
class Shown:
    """A frame as one detector saw it; frames with the same place are the same instant of the same world.

    Args:
        rig: through which it was recorded.
        name: of the detector.
        place: which of the frames that are shown.
        pictures: with truth and predictions.
    """

    rig: str
    name: str
    place: int
    pictures: FramePictures


@dataclass(frozen=True, eq=False)
class NovelViewPictures:
    """Three pictures of one instant.

    Args:
        settings: the source rig as it is, with full overlap, higher and lower.
        compared: the target rig, recorded and rendered.
        overview: what each method found through the target rig, on the point cloud.
    """

    settings: Path
    compared: Path
    overview: Path


@dataclass(frozen=True, eq=False)
class DemoPage:
    """Everything the report shows.

    Args:
        rows: of result.json.
        reports: (name, rig, score) in the order of the rows.
        frames_per_rig: how many frames were scored.
        worlds: from how many worlds.
        min_score: predictions below are not drawn.
        shown: pictures of some frames.
        novel_views: one instant rebuilt as Gaussians.
        prior_maps: picture of the prior maps of both rigs.
        top_views: picture of where the cameras sit.
        difference: both rigs in words and numbers.
        detectors: one line about each checkpoint.
        seconds: what took how long.
    """

    rows: Sequence[dict[str, Any]]
    reports: Sequence[tuple[str, str, Report]]
    frames_per_rig: int
    worlds: int
    min_score: float
    shown: Sequence[Shown]
    novel_views: NovelViewPictures
    prior_maps: Path
    top_views: Path
    difference: str
    detectors: Sequence[str]
    seconds: dict[str, float]


def demo_page(content: DemoPage) -> str:
    """The report as one HTML file."""
    parts = [_head, _numbers, _pictures, _novel_views, _rigs, _making]
    return page(TITLE, [line for part in parts for line in part(content)])


def _head(content: DemoPage) -> list[str]:
    return [
        f"<h1>{text(TITLE)}</h1>",
        paragraph(
            "Detectors trained on the cameras of one vehicle usually fail on those of another. Two small detectors, both "
            "trained through the nuScenes-like rig alone, look at the same worlds through that rig and through a "
            "Waymo-like rig they have never seen.",
            "lead",
        ),
        paragraph(TOWN_ONLY, "note"),
    ]


def _numbers(content: DemoPage) -> list[str]:
    header = ["method", "detector", "source", "target", "mAP", "mATE", "mASE", "mAOE", "NDS*", "objects", "predictions"]
    keys = ["method", "detector", "source", "target", "mAP", "mATE", "mASE", "mAOE", "NDS*", "truth_boxes", "predicted_boxes"]
    open_header = ["method", "target", "mAP", "NDS*", "objects", "predictions"]
    open_rows = [
        [r["method"], r["target"], *(r["unfiltered"][k] for k in ("mAP", "NDS*", "truth_boxes", "predicted_boxes"))]
        for r in content.rows
    ]
    report = content.reports[0][2]
    return [
        "<h2>The numbers</h2>",
        table(header, [[row[key] for key in keys] for row in content.rows]),
        paragraph(
            f"Higher is better for mAP and NDS*, lower for the errors mATE (metres), mASE (1 - IoU of sizes) and mAOE "
            f"(radians). {content.frames_per_rig} frames per rig from {content.worlds} worlds: a small sample, in which "
            "differences of a few hundredths mean nothing. "
            + "direct: with BEVDepth's own camera-aware gate (the paper's Direct Transfer). "
            + "coin3d: spatial-aware feature modulation, which reads the prior maps below."
        ),
        paragraph(f"Protocol: {report.protocol.describe()}."),
        "<details><summary>The same without the visibility and LiDAR filters, and per class</summary>",
        table(open_header, open_rows),
        *(f"<h3>{text(name)} on the {text(rig)} rig</h3><pre>{text(r.table())}</pre>" for name, rig, r in content.reports),
        "</details>",
    ]


def _pictures(content: DemoPage) -> list[str]:
    parts = [
        "<h2>What they see</h2>",
        f"<p>{_swatch(TRUTH)}truth, as far as the protocol scores it &nbsp; {_swatch(PREDICTION)}predictions with a score of "
        f"at least {content.min_score:g}. The front of a box is crossed. In the top view forward is up, rings are 10 m "
        "apart.</p>",
    ]
    for rig in dict.fromkeys(shown.rig for shown in content.shown):
        parts.append(f"<h3>{text(rig)} rig{'' if rig == content.shown[0].rig else ', never trained on'}</h3>")
        # one frame after the other, so that the methods can be compared
        for shown in sorted((s for s in content.shown if s.rig == rig), key=lambda s: s.place):
            cameras = figure(shown.pictures.cameras, f"{shown.name} on the {rig} rig")
            parts.append(f'<div class="pair">{cameras}{figure(shown.pictures.above, f"{shown.name}, from above")}</div>')
    return parts


def _novel_views(content: DemoPage) -> list[str]:
    source, target = dict.fromkeys(rig for _, rig, _ in content.reports)
    views = content.novel_views
    return [
        "<h2>Novel views</h2>",
        paragraph(
            f"One frame as 3D Gaussians, built without training from the images and LiDAR sweeps of the {source} rig. Rendered "
            "through other rigs they are the training data of CoIn3D's augmentation. What no camera saw stays black."
        ),
        figure(read_image(views.settings), f"the {source} rig as it is, with full overlap, 1 m higher and 1 m lower"),
        figure(read_image(views.compared), f"the {target} rig: recorded above, rendered from the other rig's images below"),
        figure(read_image(views.overview), f"truth, and what each method found through the {target} rig"),
    ]


def _rigs(content: DemoPage) -> list[str]:
    return [
        "<h2>How the rigs differ</h2>",
        paragraph(
            "The prior maps below are all that CoIn3D tells the detector about the cameras: inverse focal length, depth of "
            "the ground, its growth from row to row, and the ray of each pixel as Plücker direction and moment. They follow "
            "from the calibration alone, so a new rig brings its own."
        ),
        figure(read_image(content.prior_maps), "prior maps of every camera of both rigs"),
        figure(read_image(content.top_views), "where the cameras sit and look"),
        f"<details><summary>Both rigs in numbers</summary><pre>{text(content.difference)}</pre></details>",
    ]


def _making(content: DemoPage) -> list[str]:
    times = ", ".join(f"{name} {seconds:g} s" for name, seconds in content.seconds.items())
    return [
        "<h2>How this was made</h2>",
        "<ul>" + "".join(f"<li>{text(line)}</li>" for line in content.detectors) + "</ul>",
        paragraph(
            "The worlds are procedural and ray-cast; both rigs recorded the same ones, none of which was used in training. "
            f"Time: {times}."
        ),
        paragraph(
            "This is an independent implementation of CoIn3D: Revisiting Configuration-Invariant Multi-Camera 3D Object "
            "Detection (Kuang et al., CVPR 2026). The numbers are the town's, not the paper's."
        ),
    ]


def _swatch(colour: RGB) -> str:
    return f'<span class="swatch" style="background: rgb{colour}"></span>'
