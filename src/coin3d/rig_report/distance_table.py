"""The distance of a rig to a training as parts of a page: what was seen, words, numbers."""

from __future__ import annotations

from collections.abc import Sequence

from coin3d.augmentation import NovelViewOptions
from coin3d.report.html import paragraph, table
from coin3d.rig_report.prior_distance import CameraDistance, RigDistance
from coin3d.rig_report.verdict import Verdict
from coin3d.training.seen_rigs import TrainingRigs

_HEADER = (
    "camera", "inverse focal", "focal", "ground depth", "depth", "ground gradient", "growth at 20 m", "ray direction", "up to",
    "ray place", "typical", "nearest yaw",
)  # fmt: skip


def distance_parts(
    distance: RigDistance, found: Sequence[Verdict], advice: str, training: TrainingRigs, source: str
) -> list[str]:
    """Everything above the pictures.

    Args:
        distance: the numbers.
        found: the words about every camera.
        advice: what to do.
        training: what the rig was compared with.
        source: where that comes from, in words.
    """
    width, height = training.size_px
    rows = [[v.name, v.level, " ".join(v.findings)] for v in found]
    parts = [
        paragraph(f"{source + ' ' if source else ''}{what_was_seen(training)} Network input {width} x {height}.", "lead"),
        paragraph(advice, "note"),
        table(("camera", "against training", "what is new"), rows),
        paragraph("The words follow from geometry by fixed limits. No accuracy was measured for them."),
        "<h2>The four priors</h2>",
        paragraph(
            "Shares are of image cells whose value training never showed (ground: in the same row). Beside them the "
            "distance to the nearest value it did show: focal length and ground depth as ratios, growth of ground depth per "
            "image row where the ground is 20 m deep, rays in degrees from the nearest direction that was looked in and in "
            "metres from the nearest parallel ray. How each is defined: src/coin3d/rig_report/prior_distance.py."
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


def what_was_seen(training: TrainingRigs) -> str:
    """The training rigs and what augmentation made of them, in words."""
    count = len(training.rigs)
    names = ", ".join(dict.fromkeys(rig.name for rig in training.rigs))
    parts = [f"Training rigs: {names} ({count} distinct {'rig' if count == 1 else 'rigs'})."]
    if training.focal is not None:
        parts.append(f"Raw images were zoomed by {training.focal.min_ratio:g} to {training.focal.max_ratio:g}.")
    if training.novel_views is not None:
        parts.append(_novel_views(training.novel_views))
    if training.max_rotation_deg:
        parts.append(f"Images were turned by up to {training.max_rotation_deg:g} degrees.")
    if training.half_turn_probability:
        parts.append(f"{training.half_turn_probability:.0%} of samples of rigs that do not see behind were turned about.")
    return " ".join(parts)


def _novel_views(options: NovelViewOptions) -> str:
    s = options.sampler
    ranges = f"height {s.height_m[0]:g} to {s.height_m[1]:g} m, tilt {s.tilt_deg:g} degrees to both sides"
    if s.mounts:
        ranges += ", and target-aware ranges for each camera"
    else:
        ranges += (
            f", focal length times {s.focal_ratio[0]:g} to {s.focal_ratio[1]:g}, {s.shift_m:g} m in x and y, yaw {s.yaw_deg:g} "
            "degrees to both sides"
        )
    array = "; cameras dropped, added, laid out anew" if s.array is not None else ""
    return f"{options.probability:.0%} of samples were to be rendered through rigs drawn at random: {ranges}{array}."


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
