"""Exponential moving average of the weights; the average is what is evaluated and shipped."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn


class WeightAverage:
    """Averages all floating-point weights and buffers; the decay ramps up so that the start is forgotten.

    Args:
        model: what is averaged.
        decay: final decay; 0 follows the model exactly.
        ramp_steps: decay(t) = decay * (1 - exp(-t / ramp_steps)); the form is spec official_code 1.7's, whose 2000 steps
            belong to runs of 20,000 and more.
    """

    def __init__(self, model: nn.Module, decay: float, ramp_steps: float = 200.0) -> None:
        self.decay, self.ramp_steps = decay, ramp_steps
        self.weights: dict[str, Tensor] = {k: v.detach().clone() for k, v in model.state_dict().items()}

    @torch.no_grad()
    def update(self, model: nn.Module, step: int) -> None:
        """Take in the weights after optimiser step ``step`` (counted from 0)."""
        keep = self.decay * (1 - math.exp(-(step + 1) / self.ramp_steps))
        for name, value in model.state_dict().items():
            if value.is_floating_point():
                self.weights[name].lerp_(value.detach(), 1 - keep)
            else:
                self.weights[name].copy_(value)
