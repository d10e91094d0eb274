"""Targets and losses of the CenterPoint head."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from coin3d.detectors.center_head import REGRESSIONS
from coin3d.detectors.lift_splat import BevGrid
from coin3d.geometry import Boxes3D

_MAX_OBJECTS = 500


@dataclass(frozen=True)
class CenterTargets:
    """Targets of a batch.

    Args:
        heatmap: (B, classes, Y, X) with a Gaussian at every centre.
        sample: (N,) sample of each object.
        cell: (N,) flat cell y * side + x.
        values: (N, 8) regression targets in the order offset 2, height 1, size 3, heading 2.
        label: (N,) class of each object.
        velocity_mps: (N, 2) along x and y; NaN where unknown.
    """

    heatmap: Float[Tensor, "b k y x"]
    sample: Int[Tensor, "n"]
    cell: Int[Tensor, "n"]
    values: Float[Tensor, "n 8"]
    label: Int[Tensor, "n"]
    velocity_mps: Float[Tensor, "n 2"]

    def to(self, device: torch.device | str) -> CenterTargets:
        return CenterTargets(*(getattr(self, f.name).to(device) for f in fields(self)))


def gaussian_radius(length_cells: float, width_cells: float, min_overlap: float) -> float:
    """Largest shift of a corner that keeps the given overlap with the box (CornerNet's three cases, smallest wins)."""
    s, p = length_cells + width_cells, length_cells * width_cells
    cases = [
        (1.0, s, p * (1 - min_overlap) / (1 + min_overlap)),
        (4.0, 2 * s, (1 - min_overlap) * p),
        (4 * min_overlap, -2 * min_overlap * s, (min_overlap - 1) * p),
    ]
    # the released heads all use (b + sqrt(b^2 - 4ac)) / 2, not divided by a: kept, because it sets the peak's width
    return float(min((b + np.sqrt(b * b - 4 * a * c)) / 2 for a, b, c in cases))


def center_targets(
    boxes: Sequence[Boxes3D],
    classes: Sequence[str],
    grid: BevGrid,
    *,
    min_radius_cells: int = 2,
    min_overlap: float = 0.1,
    single_precision: bool = False,
) -> CenterTargets:
    """Encode the ground truth of B samples; boxes outside the grid or of other classes are left out.

    Args:
        boxes: B tables in the BEV frame.
        classes: names in heat-map order.
        grid: cells of the heat map.
        min_radius_cells: smallest peak.
        min_overlap: a peak reaches as far as a box may be moved and still overlap itself this much.
        single_precision: places are rounded as in the released code, which moves a centre on the border of two cells into
            the other one now and then.
    """
    kind: type[Any] = np.float32 if single_precision else np.float64
    half_extent_m, cell_m = kind(grid.half_extent_m), kind(grid.cell_m)
    side = grid.side
    heatmap = np.zeros((len(boxes), len(classes), side, side), dtype=np.float32)
    samples, cells, values, kinds, velocities = [], [], [], [], []
    for b, table in enumerate(boxes):
        place = (table.centre_m[:, :2].astype(kind) + half_extent_m) / cell_m
        for i in range(min(len(table), _MAX_OBJECTS)):
            x, y = np.floor(place[i]).astype(int)
            if table.labels[i] not in classes or not (0 <= x < side and 0 <= y < side):
                continue
            length, width = table.size_m[i, :2] / grid.cell_m
            radius = max(min_radius_cells, int(gaussian_radius(length, width, min_overlap)))
            kinds.append(list(classes).index(str(table.labels[i])))
            _draw_peak(heatmap[b, kinds[-1]], x, y, radius)
            offset = place[i] - (x, y)
            yaw = table.yaw_rad[i]
            samples.append(b)
            velocities.append(table.velocity_mps[i])
            cells.append(y * side + x)
            values.append([*offset, table.centre_m[i, 2], *np.log(table.size_m[i]), np.sin(yaw), np.cos(yaw)])
    return CenterTargets(
        torch.from_numpy(heatmap),
        torch.tensor(samples, dtype=torch.long),
        torch.tensor(cells, dtype=torch.long),
        torch.tensor(np.asarray(values, dtype=np.float32).reshape(-1, 8)),
        torch.tensor(kinds, dtype=torch.long),
        torch.tensor(np.asarray(velocities, dtype=np.float32).reshape(-1, 2)),
    )


def _draw_peak(heatmap: Float[np.ndarray, "y x"], x: int, y: int, radius: int) -> None:
    side = heatmap.shape[0]
    sigma = (2 * radius + 1) / 6
    ys = np.arange(max(0, y - radius), min(side, y + radius + 1))
    xs = np.arange(max(0, x - radius), min(side, x + radius + 1))
    peak = np.exp(-((ys[:, None] - y) ** 2 + (xs[None] - x) ** 2) / (2 * sigma**2))
    window = heatmap[ys[0] : ys[-1] + 1, xs[0] : xs[-1] + 1]
    np.maximum(window, peak, out=window)


def focal_loss(logits: Float[Tensor, "b k y x"], target: Float[Tensor, "b k y x"]) -> Float[Tensor, ""]:
    """Gaussian focal loss (alpha 2, gamma 4) per positive cell."""
    p = logits.sigmoid().clamp(1e-4, 1 - 1e-4)
    positive = target.eq(1)
    at_peaks = -((1 - p) ** 2) * p.log() * positive
    elsewhere = -(p**2) * (1 - p).log() * (1 - target) ** 4
    return (at_peaks.sum() + elsewhere.sum()) / positive.sum().clamp(min=1)


def center_losses(
    outputs: dict[str, Float[Tensor, "b k y x"]],
    targets: CenterTargets,
    *,
    heatmap_weight: float = 6.0,
    box_weight: float = 1.5,
) -> dict[str, Float[Tensor, ""]]:
    """Focal loss of the heat map and an L1 loss per regression, each averaged over its objects."""
    losses = {"heatmap": heatmap_weight * focal_loss(outputs["heatmap"], targets.heatmap)}
    start = 0
    for name, channels in REGRESSIONS.items():
        wanted = targets.values[:, start : start + channels]
        start += channels
        at_objects = outputs[name].flatten(2)[targets.sample, :, targets.cell]
        losses[name] = box_weight * (at_objects - wanted).abs().sum() / (len(wanted) + 1e-4)
    return losses
