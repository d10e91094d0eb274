"""Draw the log of a run."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from coin3d.records import write_bytes


def draw_curves(log: Path, picture: Path) -> None:
    """Losses (smoothed), learning rate and step time of ``log.jsonl`` as one picture."""
    rows = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines() if line]
    steps = np.array([r["step"] for r in rows])
    figure = Figure(figsize=(11, 4), layout="constrained")
    FigureCanvasAgg(figure)
    losses, times = figure.subplots(1, 2, width_ratios=[2, 1])
    for name in rows[0]["losses"]:
        losses.semilogy(steps, _smooth(np.array([r["losses"][name] for r in rows])), label=name, lw=1.2)
    losses.semilogy(steps, _smooth(np.array([r["total"] for r in rows])), label="total", color="black", lw=1.5)
    losses.set(xlabel="step", ylabel="weighted loss", title="losses, running mean")
    losses.legend(ncols=2, fontsize=8)
    losses.grid(alpha=0.3)
    times.plot(steps, [r["seconds"] for r in rows], lw=0.5, label="step")
    times.plot(steps, [r["data_seconds"] for r in rows], lw=0.5, label="of which waiting for data")
    times.set(xlabel="step", ylabel="seconds", title="time", ylim=(0, 3 * float(np.median([r["seconds"] for r in rows]))))
    times.legend(fontsize=8)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    write_bytes(picture, buffer.getvalue())


def _smooth(values: np.ndarray, width: int = 25) -> np.ndarray:
    width = min(width, len(values))
    padded = np.concatenate([np.full(width - 1, values[0]), values])
    return np.convolve(padded, np.ones(width) / width, mode="valid")
