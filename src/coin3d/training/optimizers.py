"""Which optimiser updates which weights."""

from __future__ import annotations

from torch import nn, optim

from coin3d.training.muon import Muon
from coin3d.training.options import TrainOptions

Optimizers = list[tuple[optim.Optimizer, float]]
"""Optimisers, each with its peak learning rate."""

_SMALLEST_MATRIX = 16  # fewer outputs (regression heads) make too few directions to orthogonalise


def build_optimizers(model: nn.Module, options: TrainOptions) -> Optimizers:
    """The optimisers of a run.

    ``adamw`` updates everything; ``muon`` updates the convolutions, and AdamW what remains (norms, biases, linear
    layers of the camera gate, output layers).
    """
    if options.optimizer == "adamw":
        return [(_adamw(list(model.parameters()), options), options.learning_rate)]
    matrices = [p for p in model.parameters() if p.ndim == 4 and min(len(p), p[0].numel()) >= _SMALLEST_MATRIX]
    chosen = {id(p) for p in matrices}
    rest = [p for p in model.parameters() if id(p) not in chosen]
    return [
        (Muon(matrices, lr=options.muon_learning_rate), options.muon_learning_rate),
        (_adamw(rest, options), options.learning_rate),
    ]


def _adamw(parameters: list[nn.Parameter], options: TrainOptions) -> optim.AdamW:
    return optim.AdamW(parameters, lr=options.learning_rate, weight_decay=options.weight_decay)
