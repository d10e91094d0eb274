"""From head outputs to boxes: best cells, then rotated non-maximum suppression."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from coin3d.detectors.lift_splat import BevGrid
from coin3d.detectors.nms import rotated_nms
from coin3d.geometry import Boxes3D


@dataclass(frozen=True)
class DecodeOptions:
    """How boxes are read off the head.

    Args:
        max_boxes: cells considered per sample, over all classes.
        min_score: weaker cells are dropped.
        nms_iou: bird's-eye-view overlap at which the weaker box goes.
        nms_size_factors: per class, the boxes are compared at this share of their size; at full size if empty.
        max_kept: boxes left per sample.
    """

    max_boxes: int = 500
    min_score: float = 0.1
    nms_iou: float = 0.2
    nms_size_factors: tuple[float, ...] = ()
    max_kept: int = 500


def decode_centers(
    outputs: dict[str, Float[Tensor, "b _ y x"]], classes: Sequence[str], grid: BevGrid, options: DecodeOptions
) -> list[Boxes3D]:
    """Boxes of each sample in the BEV frame, best score first."""
    maps = {name: values.detach().float().cpu() for name, values in outputs.items()}
    decoded = []
    for b in range(len(maps["heatmap"])):
        of_sample = {name: values[b] for name, values in maps.items()}
        scores, label, cell = best_cells(of_sample["heatmap"].sigmoid(), options.max_boxes, options.min_score)
        centre_m, size_m, yaw_rad = boxes_at(of_sample, cell, grid)
        names = np.asarray(classes, dtype=np.str_)[label.numpy()]
        boxes = Boxes3D.create(centre_m.numpy(), size_m.numpy(), yaw_rad.numpy(), names, scores=scores.numpy())
        factors = np.asarray(options.nms_size_factors or np.ones(len(classes)))[label.numpy()]
        compared = replace(boxes, size_m=boxes.size_m * factors[:, None])
        kept = rotated_nms(compared, options.nms_iou)[: options.max_kept]
        decoded.append(boxes[kept])
    return decoded


def best_cells(
    heatmap: Float[Tensor, "k y x"], count: int, min_score: float
) -> tuple[Float[Tensor, "n"], Int[Tensor, "n"], Int[Tensor, "n"]]:
    """Scores, classes and flat cells of the best places of one sample, best first.

    The best of each class are found first, then the best of those, which decides between equal scores as the released code
    does (a sigmoid in single precision makes many that are equal to 1).
    """
    of_class, cell = torch.topk(heatmap.flatten(1), min(count, heatmap[0].numel()))
    scores, flat = torch.topk(of_class.flatten(), min(count, of_class.numel()))
    flat, scores = flat[scores > min_score], scores[scores > min_score]
    return scores, torch.div(flat, of_class.shape[1], rounding_mode="floor"), cell.flatten()[flat]


def boxes_at(
    maps: dict[str, Float[Tensor, "_ y x"]], cell: Int[Tensor, "n"], grid: BevGrid
) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"], Float[Tensor, "n"]]:
    """Centres, sizes and headings that the maps of one sample hold at flat cells."""
    offset, height, log_size, heading = (maps[name].flatten(1)[:, cell] for name in ("offset", "height", "size", "heading"))
    row, column = torch.div(cell, grid.side, rounding_mode="floor"), cell % grid.side
    x = (column + offset[0]) * grid.cell_m - grid.half_extent_m
    y = (row + offset[1]) * grid.cell_m - grid.half_extent_m
    yaw_rad = torch.atan2(heading[0], heading[1])
    return torch.stack([x, y, height[0]], dim=1), log_size.clamp(-5, 5).exp().T, yaw_rad
