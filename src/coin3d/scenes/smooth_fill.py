"""Fill the unknown part of a map so that it bends where the image has edges and nowhere else."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Shaped

_COLOUR_SCALE = 0.06
_MIN_WEIGHT = 1e-3
_SMALLEST = 500
_TOLERANCE = 1e-3
_MAX_ROUNDS = 100


def smooth_fill(
    values: Float[np.ndarray, "h w"],
    known: Bool[np.ndarray, "h w"],
    outside: Bool[np.ndarray, "h w"],
    guide: Float[np.ndarray, "h w 3"],
    prior: Float[np.ndarray, "h w"],
    prior_weight: Float[np.ndarray, "h w"],
) -> Float[np.ndarray, "h w"]:
    """Weighted least squares: minimise sum w_ij (x_i - x_j)^2 + sum p_i (x_i - prior_i)^2 over the unknown pixels.

    Neighbours i, j pull at each other with w = exp(-|colour difference| / 0.06), so steps of x settle on image edges.
    Known pixels keep their value. Solved from coarse to fine by conjugate gradients.

    Args:
        values: the map; read where known.
        known: where it is known.
        outside: pixels that neither get a value nor pass one on (they come out as given).
        guide: the image, 0 to 1.
        prior: value that unknown pixels are drawn to.
        prior_weight: how strongly; a little everywhere, or parts without any known pixel have no answer.

    Raises:
        ValueError: somewhere unknown the prior has no weight.
    """
    unknown = ~known & ~outside
    if not unknown.any():
        return values.astype(np.float32)
    if not (prior_weight[unknown] > 0).all():
        raise ValueError("smooth_fill: every unknown pixel needs a prior_weight above 0")
    pulls = _Pulls.between(known, outside, guide, prior_weight)
    right = prior_weight * prior + pulls.from_known(np.where(known, values, 0))
    large = unknown.sum() > _SMALLEST
    start = _coarse_answer(values, known, outside, guide, prior, prior_weight) if large else prior
    answer = _conjugate_gradients(pulls, np.where(unknown, right, 0), np.where(unknown, start, 0))
    return np.where(unknown, answer, values).astype(np.float32)


@dataclass(frozen=True, eq=False)
class _Pulls:
    """The normal equations as maps: weights of horizontal and vertical neighbour pairs, and the diagonal.

    Args:
        across: (h, w - 1) weights between unknown pixels and their right neighbours, zero for other pairs.
        down: (h - 1, w) the same for the neighbours below.
        across_fixed: (h, w - 1) weights of pairs of an unknown and a known pixel.
        down_fixed: (h - 1, w) the same.
        diagonal: (h, w) all that pulls at a pixel; 1 where it is not unknown.
        unknown: (h, w).
    """

    across: Float[np.ndarray, "h v"]
    down: Float[np.ndarray, "g w"]
    across_fixed: Float[np.ndarray, "h v"]
    down_fixed: Float[np.ndarray, "g w"]
    diagonal: Float[np.ndarray, "h w"]
    unknown: Bool[np.ndarray, "h w"]

    @classmethod
    def between(
        cls,
        known: Bool[np.ndarray, "h w"],
        outside: Bool[np.ndarray, "h w"],
        guide: Float[np.ndarray, "h w 3"],
        prior_weight: Float[np.ndarray, "h w"],
    ) -> _Pulls:
        unknown = ~known & ~outside
        diagonal = prior_weight.astype(np.float32)
        free, fixed = [], []
        for near, far in (_ACROSS, _DOWN):
            weight = np.exp(np.abs(guide[near] - guide[far]).max(-1) * np.float32(-1 / _COLOUR_SCALE)) + np.float32(_MIN_WEIGHT)
            weight *= ~outside[near] & ~outside[far]
            diagonal[near] += weight
            diagonal[far] += weight
            free.append(weight * (unknown[near] & unknown[far]))
            fixed.append(weight * (unknown[near] ^ unknown[far]))
        return cls(free[0], free[1], fixed[0], fixed[1], np.where(unknown, diagonal, np.float32(1)), unknown)

    def from_known(self, values: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
        """What known neighbours (values elsewhere are zero) contribute to the right-hand side."""
        total = np.zeros(values.shape, dtype=np.float32)
        for (near, far), weight in ((_ACROSS, self.across_fixed), (_DOWN, self.down_fixed)):
            total[near] += weight * values[far]
            total[far] += weight * values[near]
        return total

    def apply(self, x: Float[np.ndarray, "h w"], out: Float[np.ndarray, "h w"]) -> None:
        """``out`` becomes the matrix times x; x is zero where nothing is unknown, and so is the result."""
        np.multiply(self.diagonal, x, out=out)
        for (near, far), weight in ((_ACROSS, self.across), (_DOWN, self.down)):
            out[near] -= weight * x[far]
            out[far] -= weight * x[near]


_ALL = slice(None)
_ACROSS = ((_ALL, slice(None, -1)), (_ALL, slice(1, None)))
_DOWN = ((slice(None, -1), _ALL), (slice(1, None), _ALL))


def _conjugate_gradients(
    pulls: _Pulls, right: Float[np.ndarray, "h w"], start: Float[np.ndarray, "h w"]
) -> Float[np.ndarray, "h w"]:
    """Solve with the diagonal as preconditioner; float32 maps, float64 sums."""
    x, product = start.astype(np.float32), np.empty(right.shape, dtype=np.float32)
    pulls.apply(x, product)
    residual = right.astype(np.float32) - product
    scaled = residual / pulls.diagonal
    direction = scaled.copy()
    now = _dot(residual, scaled)
    enough = _TOLERANCE**2 * max(_dot(right, right / pulls.diagonal), 1e-30)
    for _ in range(_MAX_ROUNDS):
        if now <= enough:
            break
        pulls.apply(direction, product)
        step = np.float32(now / _dot(direction, product))
        x += step * direction
        residual -= step * product
        np.divide(residual, pulls.diagonal, out=scaled)
        before, now = now, _dot(residual, scaled)
        direction *= np.float32(now / before)
        direction += scaled
    return x


def _dot(a: Float[np.ndarray, "h w"], b: Float[np.ndarray, "h w"]) -> float:
    return float(np.einsum("ij,ij->", a, b, dtype=np.float64))


def _coarse_answer(
    values: Float[np.ndarray, "h w"],
    known: Bool[np.ndarray, "h w"],
    outside: Bool[np.ndarray, "h w"],
    guide: Float[np.ndarray, "h w 3"],
    prior: Float[np.ndarray, "h w"],
    prior_weight: Float[np.ndarray, "h w"],
) -> Float[np.ndarray, "h w"]:
    """The answer on a map of half the size, enlarged."""
    height, width = values.shape
    half = ((width + 1) // 2, (height + 1) // 2)

    def shrunk(x: Shaped[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        return np.asarray(cv2.resize(x.astype(np.float32), half, interpolation=cv2.INTER_AREA))

    share = shrunk(known)
    coarse_known = share > 0
    coarse_values = shrunk(np.where(known, values, 0)) / np.maximum(share, 1e-6)
    coarse_outside = ~coarse_known & (shrunk(outside) > 0.5)
    coarse = smooth_fill(coarse_values, coarse_known, coarse_outside, shrunk(guide), shrunk(prior), 4 * shrunk(prior_weight))
    return np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR))
