"""How much the numbers owe to the choice of scenes: bootstrap intervals, without matching again.

Frames of a scene resemble each other, so scenes are drawn and not frames: as many as there are, with replacement. A scene
drawn twice counts twice. The ranked list of hits and misses stays what it is; only how much each of its rows weighs changes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from coin3d.evaluation.curves import RECALL_GRID
from coin3d.evaluation.matching import Matches
from coin3d.evaluation.protocol import Protocol

_MAX_HITS = 2000
"""Curves go through this many hits of a list, evenly spread, and straight between them."""

Bounds = tuple[float, float]


@dataclass(frozen=True)
class Intervals:
    """Percentile intervals of every number.

    Args:
        overall: mAP, mATE, mASE, mAOE, NDS* -> lower and upper bound.
        classes: class -> AP, ATE, ASE, AOE, NDS* -> lower and upper bound.
        level: share of the resamples between the bounds.
        resamples: how often scenes were drawn.
        scenes: how many there are.
    """

    overall: Mapping[str, Bounds]
    classes: Mapping[str, Mapping[str, Bounds]]
    level: float
    resamples: int
    scenes: int

    def row(self) -> dict[str, Any]:
        """Plain numbers for ``result.json``."""
        return {
            **{name: list(bounds) for name, bounds in self.overall.items()},
            "classes": {c: {name: list(bounds) for name, bounds in found.items()} for c, found in self.classes.items()},
            "level": self.level,
            "resamples": self.resamples,
            "scenes": self.scenes,
        }

    def table(self) -> str:
        """Plain text: one line per class and one for the means."""
        lines = ["".join([f"{'interval':<12}", *(f"{name:>16}" for name in ("AP", "ATE", "ASE", "AOE", "NDS*"))])]
        for name, found in {**self.classes, "mean": self.overall}.items():
            lines.append("".join([f"{name:<12}", *(f"{f'{low:.3f} .. {high:.3f}':>16}" for low, high in found.values())]))
        lines.append(f"{self.level:.0%} of {self.resamples} draws of {self.scenes} scenes with replacement lie within")
        return "\n".join(lines)


@dataclass(frozen=True, eq=False)
class Resampled:
    """Numbers of one class under R weightings of the scenes: ``ap`` (R,) and ``errors`` (R, 3)."""

    ap: Float[np.ndarray, "r"]
    errors: Float[np.ndarray, "r 3"]

    @property
    def columns(self) -> Float[np.ndarray, "5 r"]:
        """AP, ATE, ASE, AOE, NDS*."""
        return _with_nds(np.column_stack([self.ap, self.errors]).T)


def scene_intervals(
    matches: Matches, scene_of: Mapping[str, str], *, resamples: int = 1000, seed: int = 0, level: float = 0.95
) -> Intervals:
    """Intervals from scenes drawn at random.

    Args:
        matches: of the whole data set.
        scene_of: sample token -> name of its scene.
        resamples: how often scenes are drawn.
        seed: of the draws; the same seed gives the same intervals.
        level: share of the resamples between the bounds, in (0, 1).

    Raises:
        ValueError: fewer than two scenes, or settings out of range.
    """
    places: dict[str, int] = {}
    scene = np.array([places.setdefault(scene_of[token], len(places)) for token in matches.truth.tokens], dtype=np.int64)
    if len(places) < 2:
        raise ValueError(
            f"intervals come from drawing scenes, and there is only {len(places)}: score more scenes, or leave them out"
        )
    if resamples < 1 or not 0 < level < 1:
        raise ValueError(f"intervals need at least one resample and a level in (0, 1), got {resamples} and {level:g}")
    rng = np.random.default_rng(seed)
    weights = rng.multinomial(len(places), np.full(len(places), 1 / len(places)), size=resamples).astype(np.float64)
    found = {name: resample(matches, name, scene, weights).columns for name in matches.protocol.classes}
    means = _with_nds(np.mean(list(found.values()), axis=0)[:4])
    return Intervals(
        dict(zip(("mAP", "mATE", "mASE", "mAOE", "NDS*"), _bounds(means, level), strict=True)),
        {name: dict(zip(("AP", "ATE", "ASE", "AOE", "NDS*"), _bounds(c, level), strict=True)) for name, c in found.items()},
        level,
        resamples,
        len(places),
    )


def resample(matches: Matches, class_name: str, scene: Int[np.ndarray, "s"], weights: Float[np.ndarray, "r k"]) -> Resampled:
    """Numbers of a class when scenes weigh differently; all weights 1 give those of ``metrics_of`` for up to 2,000 hits.

    Args:
        matches: of the whole data set.
        class_name: a class of the protocol.
        scene: scene of every sample of ``matches.truth``, 0 .. K-1.
        weights: (R, K) how often each scene counts.
    """
    protocol, truth, predictions = matches.protocol, matches.truth, matches.predictions
    c, num_scenes = protocol.classes.index(class_name), weights.shape[1]
    rows = matches.ranked_rows[c]
    of_group = scene[[truth.place_of[token] for token in predictions.tokens]] if predictions.tokens else scene[:0]
    ranked_scene = np.repeat(of_group, np.diff(predictions.start))[rows]
    of_object = np.repeat(scene, np.diff(truth.start))[truth.label == c]
    num_truth = weights @ np.bincount(of_object, minlength=num_scenes)
    ap = np.zeros((len(protocol.distance_thresholds_m), len(weights)))
    errors = np.ones((len(weights), 3))
    for t, threshold_m in enumerate(protocol.distance_thresholds_m):
        hit = matches.object_row[t, rows] >= 0
        if not hit.any():
            continue
        hit_errors = matches.hit_errors(class_name) if threshold_m == protocol.tp_threshold_m else np.zeros((0, int(hit.sum())))
        curve = _WeightedCurve.build(hit, ranked_scene, matches.ranked_scores[c], hit_errors, weights, num_truth)
        ap[t] = curve.average_precision(protocol)
        if len(hit_errors):
            errors = curve.mean_errors(protocol)
    return Resampled(ap.mean(axis=0), errors)


@dataclass(frozen=True, eq=False)
class _WeightedCurve:
    """R curves of one class at one threshold through M places of its ranked list, some of which are hits (H)."""

    recall: Float[np.ndarray, "r m"]
    precision: Float[np.ndarray, "r m"]
    score: Float[np.ndarray, "r m"]
    running_error: Float[np.ndarray, "e r h"]
    hit_score: Float[np.ndarray, "h"]
    any_hit: Bool[np.ndarray, "r"]

    @classmethod
    def build(
        cls,
        hit: Bool[np.ndarray, "n"],
        scene: Int[np.ndarray, "n"],
        scores: Float[np.ndarray, "n"],
        hit_errors: Float[np.ndarray, "e k"],
        weights: Float[np.ndarray, "r s"],
        num_truth: Float[np.ndarray, "r"],
    ) -> _WeightedCurve:
        num_scenes, all_hits = weights.shape[1], np.flatnonzero(hit)
        hits = all_hits[np.unique(np.linspace(0, len(all_hits) - 1, min(len(all_hits), _MAX_HITS)).round().astype(np.int64))]
        places = np.unique(np.concatenate([np.maximum(hits - 1, 0), hits, [len(hit) - 1]]))
        # the first place at or after each row: there it enters the running sums, kept per scene until they are weighted
        place_of_row = np.repeat(np.arange(len(places)), np.diff(places, prepend=-1))
        cell, shape = place_of_row * num_scenes + scene, (len(places), num_scenes)

        def running(cells: Int[np.ndarray, "q"], amount: Float[np.ndarray, "q"] | None = None) -> Float[np.ndarray, "r m"]:
            sums = np.bincount(cells, amount, minlength=shape[0] * shape[1]).reshape(shape)
            return np.asarray(weights @ sums.cumsum(axis=0, dtype=np.float64).T)

        found, seen = running(cell[all_hits]), running(cell)
        is_hit = np.searchsorted(places, hits)
        error_sums = [running(cell[all_hits], row)[:, is_hit] for row in hit_errors]
        with np.errstate(invalid="ignore", divide="ignore"):
            running_error = [_from_first(sums / found[:, is_hit]) for sums in error_sums]
            return cls(
                found / num_truth[:, None],
                _from_first(found / seen),
                _from_first(np.where(seen > 0, scores[places], np.nan)),
                np.array(running_error).reshape(len(hit_errors), len(weights), len(hits)),
                scores[hits],
                found[:, -1] > 0,
            )

    def average_precision(self, protocol: Protocol) -> Float[np.ndarray, "r"]:
        precision = self._on_grid(self.precision)
        counted = precision[:, protocol.first_recall_index :] - protocol.min_precision
        return np.asarray(np.maximum(counted, 0).mean(axis=1) / (1 - protocol.min_precision))

    def mean_errors(self, protocol: Protocol) -> Float[np.ndarray, "r e"]:
        score = self._on_grid(self.score)
        steps = np.arange(len(RECALL_GRID))
        last = np.where(score != 0, steps, 0).max(axis=1)
        counted = (steps >= protocol.first_recall_index) & (steps <= last[:, None])
        errors = np.ones((len(score), len(self.running_error)))
        for r in np.flatnonzero(counted.any(axis=1)):
            for e, running in enumerate(self.running_error[:, r]):
                errors[r, e] = np.interp(score[r, counted[r]], self.hit_score[::-1], running[::-1]).mean()
        return errors

    def _on_grid(self, values: Float[np.ndarray, "r m"]) -> Float[np.ndarray, "r 101"]:
        """Values at the recalls of the grid, 0 beyond the largest and without any hit."""
        on_grid = np.zeros((len(values), len(RECALL_GRID)))
        for r in np.flatnonzero(self.any_hit):
            on_grid[r] = np.interp(RECALL_GRID, self.recall[r], values[r], right=0)
        return on_grid


def _from_first(values: Float[np.ndarray, "r m"]) -> Float[np.ndarray, "r m"]:
    """Rows that begin with NaN, because nothing before has any weight, begin with their first number instead."""
    known = np.isfinite(values)
    first = values[np.arange(len(values)), known.argmax(axis=1)]
    return np.where(known, values, first[:, None])


def _with_nds(columns: Float[np.ndarray, "4 r"]) -> Float[np.ndarray, "5 r"]:
    nds = (3 * columns[0] + (1 - np.minimum(columns[1:], 1)).sum(axis=0)) / 6
    return np.concatenate([columns, nds[None]])


def _bounds(columns: Float[np.ndarray, "q r"], level: float) -> list[Bounds]:
    low, high = np.quantile(columns, [(1 - level) / 2, (1 + level) / 2], axis=1)
    return [(float(a), float(b)) for a, b in zip(low, high, strict=True)]
