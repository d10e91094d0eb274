"""Muon: momentum whose update of every weight matrix is made orthogonal (Jordan et al. 2024).

For networks that start from random weights and have few steps. PyTorch's own Muon takes 2-D parameters only; these are
convolutions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

_QUINTIC = (3.4445, -4.7750, 2.0315)
"""Coefficients of the Newton-Schulz step: they push every singular value of a normalised matrix to about 1 (0.7 to 1.2)."""


def orthogonalised(matrix: Float[Tensor, "r c"], steps: int = 5) -> Float[Tensor, "r c"]:
    """Roughly U V^T of the matrix's singular value decomposition U S V^T, by matrix products alone."""
    a, b, c = _QUINTIC
    wide = matrix if matrix.shape[0] <= matrix.shape[1] else matrix.T
    x = wide / (wide.norm() + 1e-7)
    # every step multiplies x from the left by a polynomial of its Gram matrix, and these all commute: they can be
    # gathered in the Gram matrix's own size, a ninth of the weight's or less
    gram = x @ x.T
    one = torch.eye(len(gram), dtype=gram.dtype, device=gram.device)
    gathered = one
    for _ in range(steps):
        factor = a * one + b * gram + c * gram @ gram
        gathered = factor @ gathered
        gram = factor @ gram @ factor
    x = gathered @ x
    result: Tensor = x if matrix.shape[0] <= matrix.shape[1] else x.T
    return result


class Muon(torch.optim.Optimizer):
    """Nesterov momentum, orthogonalised per weight; a convolution counts as a matrix of outputs x (inputs x kernel).

    Args:
        params: weights of two or more dimensions.
        lr: length of an update, per unit of sqrt(max(1, outputs / fan-in)).
        momentum: share of the past in the running gradient.
        weight_decay: decoupled, times the learning rate.
    """

    def __init__(
        self,
        params: Iterable[Tensor] | Iterable[dict[str, Any]],
        lr: float = 0.02,
        momentum: float = 0.95,
        weight_decay: float = 0.05,
    ) -> None:
        super().__init__(params, {"lr": lr, "momentum": momentum, "weight_decay": weight_decay})

    @torch.no_grad()
    def step(self, closure: Callable[[], Any] | None = None) -> None:  # type: ignore[override]
        """Update every weight that has a gradient."""
        for group in self.param_groups:
            for weight in group["params"]:
                if weight.grad is None:
                    continue
                state = self.state[weight]
                if not state:
                    state["momentum"] = torch.zeros_like(weight)
                running = state["momentum"].lerp_(weight.grad, 1 - group["momentum"])
                update = orthogonalised(weight.grad.lerp(running, group["momentum"]).flatten(1))
                reach = max(1.0, update.shape[0] / update.shape[1]) ** 0.5
                weight.mul_(1 - group["lr"] * group["weight_decay"])
                weight.add_(update.reshape(weight.shape), alpha=-group["lr"] * reach)
