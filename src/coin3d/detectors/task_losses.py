"""Losses of the CenterPoint head with several tasks (spec detectors 1, Losses)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from coin3d.detectors.center_targets import CenterTargets, focal_loss
from coin3d.detectors.task_heads import TASK_REGRESSIONS, class_range, task_maps


@dataclass(frozen=True)
class TaskLossWeights:
    """Weights of the losses.

    Args:
        heatmap: of the focal loss.
        box: of the L1 losses.
        velocity: of the velocity among them.
    """

    heatmap: float = 1.0
    box: float = 0.25
    velocity: float = 1.0


def task_losses(
    outputs: dict[str, Float[Tensor, "b _ y x"]],
    targets: CenterTargets,
    tasks: Sequence[Sequence[str]],
    weights: TaskLossWeights,
) -> dict[str, Float[Tensor, ""]]:
    """Sums over tasks of a focal loss per peak and an L1 loss per object and regression; unknown velocities cost nothing."""
    losses = {name: outputs["heatmap"].new_zeros(()) for name in ("heatmap", *TASK_REGRESSIONS)}
    values = torch.cat([targets.values, targets.velocity_mps], dim=1)
    for task in range(len(tasks)):
        maps, (first, end) = task_maps(outputs, tasks, task), class_range(tasks, task)
        losses["heatmap"] = losses["heatmap"] + weights.heatmap * focal_loss(maps["heatmap"], targets.heatmap[:, first:end])
        mine = (targets.label >= first) & (targets.label < end)
        count, start = max(1e-4, float(mine.sum())), 0
        for name, channels in TASK_REGRESSIONS.items():
            wanted = values[mine, start : start + channels]
            start += channels
            predicted = maps[name].flatten(2)[targets.sample[mine], :, targets.cell[mine]]
            wanted = torch.where(wanted.isfinite(), wanted, predicted.detach())
            weight = weights.box * (weights.velocity if name == "velocity" else 1.0)
            losses[name] = losses[name] + weight * (predicted - wanted).abs().sum() / count
    return losses
