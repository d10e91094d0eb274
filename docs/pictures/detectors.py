"""Draw where SFM enters each detector: python docs/pictures/detectors.py writes detectors.png beside itself."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

GREY, BLUE, ORANGE = "#e8eaed", "#d2e3fc", "#fbbc04"
SHARED = ("images", "ResNet", "pyramid", "SFM")
ROWS = (
    ("BEVDepth\nbottom-up", (*SHARED, "depth net", "lift-splat\nto BEV", "BEV encoder", "heat map\nof centres")),
    (
        "BEVFormer\ntop-down",
        (*SHARED, "spatial\ncross-attention", "BEV queries\nand history", "decoder of\nobject queries", "boxes"),
    ),
    (
        "PETR\nsparse queries",
        ("images", "V2-99 or\nResNet", *SHARED[2:], "cells with\n3D position", "decoder of\nobject queries", "boxes"),
    ),
)
ALSO = {1: "maps as\nchannels", 2: "placement\nreleased"}
"""Column -> how the maps enter before it: beside RGB always, as SFM of each backbone level with placement = released."""
WIDTH, HEIGHT, STEP, ROW = 1.5, 0.72, 1.85, 1.85


def box(axes: Axes, column: int, y: float, text: str) -> None:
    """A step, centred on its column."""
    colour = ORANGE if text == "SFM" else GREY if column < 3 else BLUE
    x = column * STEP
    axes.add_patch(
        FancyBboxPatch(
            (x - WIDTH / 2, y - HEIGHT / 2), WIDTH, HEIGHT, boxstyle="round,pad=0.03", fc=colour, ec="#5f6368", lw=0.8
        )
    )
    axes.text(x, y, text, ha="center", va="center", fontsize=9, weight="bold" if text == "SFM" else "normal")


def draw() -> Figure:
    """All three detectors, one row each."""
    figure = Figure(figsize=(14, 5.9), dpi=110, layout="tight")
    axes = figure.add_subplot()
    for number, (name, steps) in enumerate(ROWS):
        y = -number * ROW
        axes.text(-1.95, y, name, ha="center", va="center", fontsize=10, weight="bold")
        for column, text in enumerate(steps):
            box(axes, column, y, text)
            if column:
                arrow = {"arrowstyle": "-|>", "color": "#5f6368", "lw": 1.2}
                axes.annotate("", (column * STEP - WIDTH / 2, y), ((column - 1) * STEP + WIDTH / 2, y), arrowprops=arrow)
        for column, where in ALSO.items():
            place = (column - 0.5) * STEP
            axes.annotate(
                where, (place, y + 0.04), (place, y + 0.55), ha="center", va="bottom", fontsize=8, color="#b06000",
                arrowprops={"arrowstyle": "-|>", "color": "#f29900", "lw": 1.2, "linestyle": "--"},
            )  # fmt: skip
    bottom = -(len(ROWS) - 1) * ROW - 1.2
    axes.text(3 * STEP, bottom, "prior maps of the rig: IF, GD, GG, PR", ha="center", va="center", fontsize=9, color="#b06000")
    arrow = {"arrowstyle": "-|>", "color": "#f29900", "lw": 2}
    for number in range(len(ROWS)):
        y = -number * ROW
        start = bottom + 0.15 if number == len(ROWS) - 1 else y - ROW + HEIGHT / 2 + 0.03
        axes.annotate("", (3 * STEP, y - HEIGHT / 2 - 0.02), (3 * STEP, start), arrowprops=arrow)
    axes.set(xlim=(-2.9, 7 * STEP + 1), ylim=(bottom - 0.3, 1.1))
    axes.axis("off")
    return figure


if __name__ == "__main__":
    draw().savefig(Path(__file__).with_suffix(".png"))
