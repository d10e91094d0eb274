"""From a ranked list of hits and misses to average precision and mean errors, on the recall grid 0, 0.01 ... 1."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from coin3d.evaluation.protocol import Protocol

RECALL_GRID = np.linspace(0, 1, 101)


@dataclass(frozen=True, eq=False)
class RankedClass:
    """Detections of one class at one distance threshold, most confident first.

    Args:
        scores: (N,) descending.
        hit: (N,) whether each took an object.
        num_truth: how many objects there are.
    """

    scores: Float[np.ndarray, "n"]
    hit: Bool[np.ndarray, "n"]
    num_truth: int

    @cached_property
    def hit_ranks(self) -> Int[np.ndarray, "k"]:
        """Places of the hits in the list."""
        return np.flatnonzero(self.hit)

    @property
    def has_curve(self) -> bool:
        """Without a single hit there is no curve: AP is 0 and errors are 1."""
        return len(self.hit_ranks) > 0

    @cached_property
    def knots(self) -> Int[np.ndarray, "m"]:
        """The places that shape the curves: every hit, the detection before it, and the last of all.

        Between them only misses follow each other, at one recall; of those the first and the last decide every
        interpolation, so that the curves through the knots are those through all detections.
        """
        is_knot = self.hit.copy()
        is_knot[:-1] |= self.hit[1:]
        is_knot[-1:] = True
        return np.flatnonzero(is_knot)

    def recall(self) -> Float[np.ndarray, "m"]:
        """Fraction of the objects found up to each knot."""
        return self._found() / self.num_truth

    def precision_on_grid(self) -> Float[np.ndarray, "101"]:
        """Precision at each recall of the grid, 0 beyond the largest recall reached.

        A recall that several detections share (a hit and the misses after it) has the precision after the last miss.
        """
        return np.asarray(np.interp(RECALL_GRID, self.recall(), self._found() / (self.knots + 1), right=0))

    def score_on_grid(self) -> Float[np.ndarray, "101"]:
        """The score above which detections must be kept to reach each recall, 0 beyond the largest."""
        return np.asarray(np.interp(RECALL_GRID, self.recall(), self.scores[self.knots], right=0))

    def _found(self) -> Int[np.ndarray, "m"]:
        return np.searchsorted(self.hit_ranks, self.knots, side="right")


def average_precision(ranked: RankedClass, protocol: Protocol) -> float:
    """Mean over the recalls above ``min_recall`` of the precision above ``min_precision``, scaled to 0 .. 1."""
    if not ranked.has_curve:
        return 0.0
    counted = ranked.precision_on_grid()[protocol.first_recall_index :] - protocol.min_precision
    return float(np.maximum(counted, 0).mean() / (1 - protocol.min_precision))


def mean_errors(ranked: RankedClass, hit_errors: Float[np.ndarray, "e k"], protocol: Protocol) -> tuple[float, ...]:
    """Errors averaged over the recalls from ``min_recall`` to the largest recall reached.

    At each recall the error is the mean over all hits at least as confident, so errors of confident detections
    weigh more than those of the last ones.

    Args:
        ranked: the list whose ``hit`` rows the errors belong to.
        hit_errors: (E, K) errors of the K hits in the same order.
        protocol: gives ``min_recall``.

    Returns:
        E numbers; all 1 where the largest recall is not above ``min_recall``.
    """
    on_grid = errors_on_grid(ranked, hit_errors)
    first = protocol.first_recall_index
    last = int(np.flatnonzero(ranked.score_on_grid()).max(initial=0)) if ranked.has_curve else 0
    if last < first:
        return (1.0,) * len(hit_errors)
    return tuple(float(row[first : last + 1].mean()) for row in on_grid)


def errors_on_grid(ranked: RankedClass, hit_errors: Float[np.ndarray, "e k"]) -> Float[np.ndarray, "e 101"]:
    """At each recall of the grid the mean error of all hits at least as confident; 1 where there is no curve."""
    if not ranked.has_curve:
        return np.ones((len(hit_errors), len(RECALL_GRID)))
    running = np.cumsum(hit_errors, axis=1) / np.arange(1, hit_errors.shape[1] + 1)
    hit_scores, score_grid = ranked.scores[ranked.hit_ranks], ranked.score_on_grid()
    # np.interp wants ascending abscissae, scores descend
    return np.stack([np.interp(score_grid[::-1], hit_scores[::-1], row[::-1])[::-1] for row in running])
