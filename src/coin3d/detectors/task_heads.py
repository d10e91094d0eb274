"""CenterPoint head with several tasks: classes that look alike share their maps (spec detectors 1.12)."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from coin3d.detectors.center_head import REGRESSIONS, output_branches
from coin3d.detectors.layers import conv_bn_relu

TASK_REGRESSIONS = {**REGRESSIONS, "velocity": 2}
"""Branch -> channels of each task: those of one task alone, and the velocity in metres per second along x and y."""

Tasks = tuple[tuple[str, ...], ...]
"""Names of the classes of each task."""


class TaskHeads(nn.Module):
    """A shared convolution, then all branches once per task.

    Args:
        inputs: channels of the BEV feature.
        tasks: names of the classes of each.
        channels: width of the head.
    """

    def __init__(self, inputs: int, tasks: Tasks, channels: int = 64) -> None:
        super().__init__()
        self.shared_conv = conv_bn_relu(inputs, channels)
        self.tasks = nn.ModuleList(output_branches(channels, {**TASK_REGRESSIONS, "heatmap": len(names)}) for names in tasks)

    def forward(self, bev: Float[Tensor, "b c y x"]) -> dict[str, Float[Tensor, "b _ y x"]]:
        """Raw maps, those of one task after those of another; ``heatmap`` holds logits, one per class."""
        shared = self.shared_conv(bev)
        tasks: list[dict[str, nn.Module]] = [dict(task.items()) for task in self.tasks]  # type: ignore[operator]
        return {name: torch.cat([task[name](shared) for task in tasks], dim=1).float() for name in tasks[0]}


def class_range(tasks: Sequence[Sequence[str]], task: int) -> tuple[int, int]:
    """First class of a task and first class behind it, counted over all tasks."""
    first = sum(len(names) for names in tasks[:task])
    return first, first + len(tasks[task])


def task_maps(
    outputs: dict[str, Float[Tensor, "b _ y x"]], tasks: Sequence[Sequence[str]], task: int
) -> dict[str, Float[Tensor, "b _ y x"]]:
    """The maps of one task out of those of all."""
    first, end = class_range(tasks, task)
    maps = {"heatmap": outputs["heatmap"][:, first:end]}
    for name, channels in TASK_REGRESSIONS.items():
        maps[name] = outputs[name][:, task * channels : (task + 1) * channels]
    return maps
