"""Fill the unknown part of a map so that it bends where the image has edges and nowhere else."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float
from scipy import sparse
from scipy.sparse.linalg import cg, spsolve

_COLOUR_SCALE = 0.06
_MIN_WEIGHT = 5e-3
_DIRECT = 1500
_TOLERANCE = 1e-4
_MAX_ROUNDS = 120


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
    start = _coarse_answer(values, known, outside, guide, prior, prior_weight) if unknown.sum() > _DIRECT else None
    matrix, right = _normal_equations(values, known, outside, guide, prior, prior_weight)
    filled = values.astype(np.float32).copy()
    if start is None:
        filled[unknown] = spsolve(matrix.tocsc(), right)
        return filled
    scale = sparse.diags_array(1 / matrix.diagonal())
    answer, _ = cg(matrix, right, x0=start[unknown].astype(np.float64), rtol=_TOLERANCE, maxiter=_MAX_ROUNDS, M=scale)
    filled[unknown] = answer
    return filled


def _normal_equations(
    values: Float[np.ndarray, "h w"],
    known: Bool[np.ndarray, "h w"],
    outside: Bool[np.ndarray, "h w"],
    guide: Float[np.ndarray, "h w 3"],
    prior: Float[np.ndarray, "h w"],
    prior_weight: Float[np.ndarray, "h w"],
) -> tuple[sparse.csr_array, Float[np.ndarray, "u"]]:
    unknown = ~known & ~outside
    count = int(unknown.sum())
    number = np.full(unknown.shape, -1, dtype=np.int32)
    number[unknown] = np.arange(count, dtype=np.int32)
    diagonal = prior_weight[unknown].astype(np.float64)
    right = diagonal * prior[unknown]
    rows, columns, entries = [], [], []
    for one, other in (
        ((slice(None), slice(None, -1)), (slice(None), slice(1, None))),
        ((slice(None, -1),), (slice(1, None),)),
    ):
        weight = np.exp(-np.abs(guide[one] - guide[other]).max(-1) / _COLOUR_SCALE) + _MIN_WEIGHT
        weight[outside[one] | outside[other]] = 0
        for i, j in ((one, other), (other, one)):
            pulls = unknown[i] & (weight > 0)
            at, w = number[i][pulls], weight[pulls].astype(np.float64)
            diagonal += np.bincount(at, w, count)
            fixed = known[j][pulls]
            right += np.bincount(at[fixed], w[fixed] * values[j][pulls][fixed], count)
            rows.append(at[~fixed])
            columns.append(number[j][pulls][~fixed])
            entries.append(-w[~fixed])
    rows.append(np.arange(count))
    columns.append(np.arange(count))
    entries.append(diagonal)
    matrix = sparse.coo_array((np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))), (count, count))
    return matrix.tocsr(), right


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

    def shrunk(x: Float[np.ndarray, "h w ..."]) -> np.ndarray:
        return np.asarray(cv2.resize(x.astype(np.float32), half, interpolation=cv2.INTER_AREA))

    share = shrunk(known)
    coarse_known = share > 0
    coarse_values = shrunk(np.where(known, values, 0)) / np.maximum(share, 1e-6)
    coarse_outside = ~coarse_known & (shrunk(outside) > 0.5)
    coarse = smooth_fill(coarse_values, coarse_known, coarse_outside, shrunk(guide), shrunk(prior), 4 * shrunk(prior_weight))
    return np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR))
