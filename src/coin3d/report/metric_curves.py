"""Precision and errors over recall, as one picture."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from coin3d.evaluation import Matches
from coin3d.evaluation.curves import RECALL_GRID, average_precision, errors_on_grid, mean_errors
from coin3d.records import write_bytes

_THRESHOLD_COLOURS = ("#9ecae1", "#6baed6", "#2171b5", "#08306b")
_ERRORS = (("ATE", "m", "#d1495b"), ("ASE", "1 - IoU", "#e08e0b"), ("AOE", "rad", "#3a7d44"))


def draw_metric_curves(matches: Matches, picture: Path) -> Path:
    """One row per class: precision over recall at each threshold, and errors of the hits at the middle one.

    Recalls and precisions that do not count are shaded.
    """
    classes = matches.protocol.classes
    figure = Figure(figsize=(12, 3.9 * len(classes)), layout="constrained")
    FigureCanvasAgg(figure)
    for (left, right), name in zip(figure.subplots(len(classes), 2, squeeze=False), classes, strict=True):
        _draw_precision(left, matches, name)
        _draw_errors(right, matches, name)
        for axes in (left, right):
            axes.axvspan(0, matches.protocol.min_recall, color="#f0f0f0", zorder=0)
            axes.set(xlim=(0, 1), xlabel="recall")
            axes.grid(color="#e5e5e5")
            axes.legend(fontsize=8, loc="upper right")
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110, facecolor="white")
    write_bytes(picture, buffer.getvalue())
    return picture


def _draw_precision(axes: Axes, matches: Matches, name: str) -> None:
    protocol = matches.protocol
    shades = [_THRESHOLD_COLOURS[i] for i in np.linspace(0, 3, len(protocol.distance_thresholds_m)).round().astype(int)]
    for threshold_m, colour in zip(protocol.distance_thresholds_m, shades, strict=True):
        ranked = matches.ranked(name, threshold_m)
        label = f"{threshold_m:g} m: AP {average_precision(ranked, protocol):.3f}"
        reached = ranked.recall()[-1] >= RECALL_GRID if ranked.has_curve else np.zeros(len(RECALL_GRID), dtype=bool)
        precision = ranked.precision_on_grid()[reached] if ranked.has_curve else []
        axes.plot(RECALL_GRID[reached], precision, color=colour, lw=1.8, label=label)
    axes.axhspan(0, protocol.min_precision, color="#f0f0f0", zorder=0)
    counts = f"{matches.truth.number_of(name)} objects, {matches.predictions.number_of(name)} detections"
    axes.set(ylim=(0, 1.02), ylabel="precision", title=f"{name}: {counts}")


def _draw_errors(axes: Axes, matches: Matches, name: str) -> None:
    protocol = matches.protocol
    ranked, errors = matches.ranked(name, protocol.tp_threshold_m), matches.hit_errors(name)
    reached = ranked.recall()[-1] >= RECALL_GRID if ranked.has_curve else np.zeros(len(RECALL_GRID), dtype=bool)
    means = mean_errors(ranked, errors, protocol)
    for (kind, unit, colour), mean, row in zip(_ERRORS, means, errors_on_grid(ranked, errors), strict=True):
        axes.plot(RECALL_GRID[reached], row[reached], color=colour, lw=1.8, label=f"{kind} {mean:.3f} ({unit})")
    axes.set(
        ylim=(0, None),
        ylabel="mean error of all hits so far",
        title=f"{name}: errors of hits within {protocol.tp_threshold_m:g} m",
    )
