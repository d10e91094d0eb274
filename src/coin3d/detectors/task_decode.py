"""From the maps of several tasks to boxes: best cells of each task, then suppression by distance (spec detectors 1, Decode)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from coin3d.detectors.center_decode import best_cells, boxes_at
from coin3d.detectors.circle_nms import circle_nms
from coin3d.detectors.lift_splat import BevGrid
from coin3d.detectors.task_heads import class_range, task_maps
from coin3d.geometry import Boxes3D


@dataclass(frozen=True)
class TaskDecodeOptions:
    """How boxes are read off each task.

    Args:
        squared_distance_m2: per task; the weaker of two boxes goes whose centres are nearer. The released values are radii
            in metres by name, but are compared with squared distances.
        max_boxes: cells considered per task.
        min_score: weaker cells are dropped.
        half_extent_m: x and y of a centre lie within plus or minus this.
        half_height_m: and z within plus or minus this.
        max_kept: boxes left per task.
    """

    squared_distance_m2: tuple[float, ...] = (4.0, 12.0, 10.0, 1.0, 0.85, 0.175)
    max_boxes: int = 500
    min_score: float = 0.1
    half_extent_m: float = 61.2
    half_height_m: float = 10.0
    max_kept: int = 83


def decode_tasks(
    outputs: dict[str, Float[Tensor, "b _ y x"]], tasks: Sequence[Sequence[str]], grid: BevGrid, options: TaskDecodeOptions
) -> list[Boxes3D]:
    """Boxes of each sample with velocities, in the BEV frame, best score first; the classes of a task suppress each other."""
    found: list[list[Boxes3D]] = [[] for _ in outputs["heatmap"]]
    names = [name for task in tasks for name in task]
    for task, squared_distance_m2 in enumerate(options.squared_distance_m2):
        maps = {name: values.detach().float().cpu() for name, values in task_maps(outputs, tasks, task).items()}
        first, end = class_range(tasks, task)
        for b, boxes in enumerate(found):
            of_sample = {name: values[b] for name, values in maps.items()}
            scores, label, cell = best_cells(of_sample["heatmap"].sigmoid(), options.max_boxes, options.min_score)
            centre_m, size_m, yaw_rad = boxes_at(of_sample, cell, grid)
            velocity_mps = of_sample["velocity"].flatten(1)[:, cell].T
            known = torch.cat([size_m, yaw_rad[:, None], velocity_mps], dim=1).isfinite().all(1)
            inside = (centre_m[:, :2].abs() <= options.half_extent_m).all(1) & (centre_m[:, 2].abs() <= options.half_height_m)
            rows = np.flatnonzero((known & inside).numpy())
            kept = rows[circle_nms(centre_m[rows, :2].numpy(), scores[rows].numpy(), squared_distance_m2)[: options.max_kept]]
            boxes.append(
                Boxes3D.create(
                    centre_m[kept].numpy(),
                    size_m[kept].numpy(),
                    yaw_rad[kept].numpy(),
                    np.asarray(names[first:end], dtype=np.str_)[label[kept].numpy()],
                    scores=scores[kept].numpy(),
                    velocity_mps=velocity_mps[kept].numpy(),
                )
            )
    tables = [Boxes3D.concatenate(boxes) for boxes in found]
    return [table[np.argsort(-table.scores, kind="stable")] for table in tables]
