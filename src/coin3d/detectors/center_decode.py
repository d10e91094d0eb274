"""From head outputs to boxes: best cells, then rotated non-maximum suppression."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
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
        max_kept: boxes left per sample.
    """

    max_boxes: int = 500
    min_score: float = 0.1
    nms_iou: float = 0.2
    max_kept: int = 500


def decode_centers(
    outputs: dict[str, Float[Tensor, "b k y x"]], classes: Sequence[str], grid: BevGrid, options: DecodeOptions
) -> list[Boxes3D]:
    """Boxes of each sample in the BEV frame, best score first."""
    heatmap = outputs["heatmap"].detach().float().sigmoid().cpu()
    maps = {k: v.detach().float().cpu().flatten(2) for k, v in outputs.items()}
    decoded = []
    for b in range(len(heatmap)):
        count = min(options.max_boxes, heatmap[b].numel())
        scores, flat = torch.topk(heatmap[b].flatten(), count)
        flat, scores = flat[scores > options.min_score], scores[scores > options.min_score]
        cell = flat % (grid.side**2)
        label = torch.div(flat, grid.side**2, rounding_mode="floor")
        row, column = torch.div(cell, grid.side, rounding_mode="floor"), cell % grid.side
        offset = maps["offset"][b][:, cell]
        x = (column + offset[0]) * grid.cell_m - grid.half_extent_m
        y = (row + offset[1]) * grid.cell_m - grid.half_extent_m
        z = maps["height"][b][0, cell]
        size = maps["size"][b][:, cell].clamp(-5, 5).exp()
        sin, cos = maps["heading"][b][:, cell]
        boxes = Boxes3D.create(
            torch.stack([x, y, z], dim=1).numpy(),
            size.T.numpy(),
            torch.atan2(sin, cos).numpy(),
            np.asarray(classes, dtype=np.str_)[label.numpy()],
            scores=scores.numpy(),
        )
        kept = rotated_nms(boxes, options.nms_iou)[: options.max_kept]
        decoded.append(boxes[kept])
    return decoded
