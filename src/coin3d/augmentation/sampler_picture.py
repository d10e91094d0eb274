"""What a rig sampler draws, as one picture: histograms over many draws, and a few rigs from above."""

from __future__ import annotations

import io
from collections import Counter
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from coin3d.augmentation.rig_sampler import RigSampler
from coin3d.drawing.top_view import top_view
from coin3d.geometry import Rig
from coin3d.records import write_bytes

_EXAMPLES = 4
_BLUE, _RED = "#1f77b4", "#d1495b"


def draw_sampler(sampler: RigSampler, rig: Rig, path: Path, draws: int = 1000, seed: int = 0) -> Path:
    """Write a PNG of ``draws`` rigs drawn around ``rig``; marks in red are the rig itself."""
    rng = np.random.default_rng(seed)
    buffer = io.BytesIO()
    _figure(rig, [sampler.draw(rig, rng) for _ in range(draws)]).savefig(buffer, format="png", dpi=100, facecolor="white")
    write_bytes(path, buffer.getvalue())
    return path


def _figure(source: Rig, drawn: list[Rig]) -> Figure:
    figure = Figure(figsize=(18, 12.5), layout="constrained")
    axes = figure.subplots(3, 4)
    figure.suptitle(f"{len(drawn)} rigs drawn around '{source.name}'; red: the rig itself", fontsize=14)
    counts = Counter(len(rig) for rig in drawn)
    top = max(8, *counts)
    axes[0, 0].bar(range(1, top + 1), [counts[n] for n in range(1, top + 1)], color=_BLUE)
    axes[0, 0].axvline(len(source), color=_RED)
    axes[0, 0].set(title="number of cameras", xticks=range(1, top + 1), ylabel="rigs")
    values, own = _values(drawn), _values([source])
    for axis, name in zip(axes.flat[1:6], values, strict=True):
        _histogram(axis, name, values[name], own[name])
    _places(axes[1, 2], drawn, source)
    _mean_heights(axes[1, 3], drawn, source)
    for axis, rig in zip(axes[2], drawn[:_EXAMPLES], strict=False):
        axis.imshow(top_view(rig, range_m=14.0, size_px=420))
        axis.set(title=f"{len(rig)} cameras", xticks=[], yticks=[])
    return figure


def _values(rigs: list[Rig]) -> dict[str, np.ndarray]:
    """Per camera of all rigs."""
    pairs = [(camera, rig.ground) for rig in rigs for camera in rig.values()]
    down = [np.arcsin(np.clip(-c.ego_from_cam.rotation[2, 2], -1, 1)) for c, _ in pairs]
    return {
        "horizontal field of view (deg)": np.rad2deg([2 * np.arctan(c.width_px / 2 / abs(c.K[0, 0])) for c, _ in pairs]),
        "height above ground (m)": np.array([ground.height_m(c.ego_from_cam.translation) for c, ground in pairs]),
        "yaw (deg)": np.rad2deg([c.yaw_rad for c, _ in pairs]),
        "pitch, positive looks down (deg)": np.rad2deg(down),
        "row of the principal point / height": np.array([c.K[1, 2] / c.height_px for c, _ in pairs]),
    }


def _histogram(axis: Axes, name: str, values: np.ndarray, own: np.ndarray) -> None:
    low, high = float(min(values.min(), own.min())), float(max(values.max(), own.max()))
    margin = max(0.05 * (high - low), 0.01)  # a quantity that does not vary is one bar, not a picture of rounding
    axis.hist(values, bins=60, range=(low - margin, high + margin), color=_BLUE)
    for value in own:
        axis.axvline(value, color=_RED, linewidth=1)
    axis.set(title=name, ylabel="cameras")


def _places(axis: Axes, drawn: list[Rig], source: Rig) -> None:
    for rigs, colour, size in ((drawn, _BLUE, 2), ([source], _RED, 30)):
        places = np.stack([c.ego_from_cam.translation[:2] for rig in rigs for c in rig.values()])
        axis.scatter(-places[:, 1], places[:, 0], s=size, color=colour, alpha=0.5, linewidths=0)
    axis.set(title="places from above (m), forward is up", aspect="equal")


def _mean_heights(axis: Axes, drawn: list[Rig], source: Rig) -> None:
    def means(rigs: list[Rig]) -> list[float]:
        return [float(np.mean([r.ground.height_m(c.ego_from_cam.translation) for c in r.values()])) for r in rigs]

    axis.hist(means(drawn), bins=40, color=_BLUE)
    axis.axvline(means([source])[0], color=_RED)
    axis.set(title="mean height of a rig's cameras (m)", ylabel="rigs")
