"""Suppression by distance: by hand, against its definition, and with numbers that are none."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from coin3d.detectors.circle_nms import circle_nms


def test_by_hand() -> None:
    # in a row: best at 0; 1.9 goes (3.61 <= 4); 2 goes (exactly 4); 2.1 stays and takes 4 along; 4.2 stays
    x = np.array([2.0, 0.0, 4.0, 2.1, 4.2, 1.9])
    scores = np.array([0.5, 0.9, 0.3, 0.7, 0.2, 0.8])
    assert circle_nms(np.column_stack([x, 0 * x]), scores, 4.0).tolist() == [1, 3, 4]


def test_what_is_suppressed_suppresses_nothing() -> None:
    x = np.array([0.0, 1.0, 2.0])
    assert circle_nms(np.column_stack([x, 0 * x]), np.array([0.9, 0.8, 0.7]), 1.0).tolist() == [0, 2]


def test_equal_scores_keep_their_order() -> None:
    place = np.array([[5.0, 0.0], [0.0, 0.0], [0.5, 0.0]])
    assert circle_nms(place, np.ones(3), 1.0).tolist() == [0, 1]


def test_what_is_no_number_is_never_kept() -> None:
    place = np.array([[0.0, 0.0], [np.nan, 0.0], [9.0, 0.0], [np.inf, 1.0]])
    assert circle_nms(place, np.array([np.nan, 0.9, 0.5, 0.8]), 1.0).tolist() == [2]
    assert circle_nms(np.zeros((0, 2)), np.zeros(0), 1.0).shape == (0,)


@given(st.integers(0, 10**6), st.integers(1, 30), st.floats(0.01, 20.0))
def test_definition(seed: int, count: int, squared_distance_m2: float) -> None:
    rng = np.random.default_rng(seed)
    place, scores = rng.uniform(-5, 5, (count, 2)), rng.permutation(count) / count
    kept = circle_nms(place, scores, squared_distance_m2)
    assert (np.diff(scores[kept]) < 0).all()
    near = ((place[:, None] - place[None, kept]) ** 2).sum(-1) <= squared_distance_m2
    # a row is kept if and only if no better kept row is near it
    beaten = (near & (scores[kept][None] > scores[:, None])).any(1)
    assert sorted(kept.tolist()) == np.flatnonzero(~beaten).tolist()
