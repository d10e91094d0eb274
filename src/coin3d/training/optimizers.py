"""Which optimiser updates which weights."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from torch import nn, optim

from coin3d.training.muon import Muon
from coin3d.training.options import TrainOptions

Optimizers = list[tuple[optim.Optimizer, float]]
"""Optimisers, each with its peak learning rate; ``rate_share`` of a parameter group is a factor on it."""

_SMALLEST_MATRIX = 16  # fewer outputs (regression heads) make too few directions to orthogonalise
_TRUNK = "backbone."


def build_optimizers(model: nn.Module, options: TrainOptions) -> Optimizers:
    """The optimisers of a run.

    ``adamw`` updates everything; ``muon`` updates the convolutions, and AdamW what remains (norms, biases, linear
    layers of the camera gate, output layers).
    """
    named = dict(model.named_parameters())
    by_muon = {n for n, p in named.items() if options.optimizer == "muon" and _is_matrix(p)}
    rest = {name: p for name, p in named.items() if name not in by_muon}

    def adamw(groups: list[dict[str, Any]]) -> optim.Optimizer:
        return optim.AdamW(groups, lr=options.learning_rate, weight_decay=options.weight_decay)

    def muon(groups: list[dict[str, Any]]) -> optim.Optimizer:
        return Muon(groups, lr=options.muon_learning_rate)

    built = [_grouped(rest, adamw, options.learning_rate, options.backbone_rate)]
    if by_muon:
        matrices = {name: named[name] for name in named if name in by_muon}
        built.insert(0, _grouped(matrices, muon, options.muon_learning_rate, options.backbone_rate))
    return built


def _is_matrix(weight: nn.Parameter) -> bool:
    return weight.ndim == 4 and min(len(weight), weight[0].numel()) >= _SMALLEST_MATRIX


def _grouped(
    named: Mapping[str, nn.Parameter],
    make: Callable[[list[dict[str, Any]]], optim.Optimizer],
    peak_rate: float,
    backbone_rate: float,
) -> tuple[optim.Optimizer, float]:
    if backbone_rate == 1.0:
        return make([{"params": list(named.values()), "rate_share": 1.0}]), peak_rate
    trunk = [p for name, p in named.items() if name.startswith(_TRUNK)]
    others = [p for name, p in named.items() if not name.startswith(_TRUNK)]
    groups = [{"params": others, "rate_share": 1.0}, {"params": trunk, "rate_share": backbone_rate}]
    return make([group for group in groups if group["params"]]), peak_rate
