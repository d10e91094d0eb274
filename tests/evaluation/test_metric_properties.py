"""What must hold for any tables: equality with the plain loops, invariances, monotony."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from box_tables import random_detections, random_truth
from hypothesis import given, settings
from hypothesis import strategies as st

from coin3d.evaluation import Metrics, Protocol, evaluate
from coin3d.evaluation.reference import evaluate_slowly
from coin3d.geometry import Boxes3D, Pose

PROTOCOL = Protocol()
Tables = tuple[dict[str, Boxes3D], dict[str, Boxes3D]]


@st.composite
def tables(draw, score_steps=(None, 0.1, 0.5)) -> Tables:
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    truth = random_truth(rng, draw(st.integers(1, 12)), draw(st.integers(0, 8)))
    # close quarters make detections compete for objects
    scale = draw(st.sampled_from([1.0, 0.2, 0.05]))
    truth = {token: replace(boxes, centre_m=boxes.centre_m * scale) for token, boxes in truth.items()}
    predictions = random_detections(
        rng,
        truth,
        found=draw(st.sampled_from([0.0, 0.3, 1.0])),
        false_per_sample=draw(st.integers(0, 8)),
        score_step=draw(st.sampled_from(score_steps)),
        noise_m=draw(st.sampled_from([0.0, 0.3, 2.0])),
    )
    return truth, predictions


def numbers(metrics: Metrics) -> np.ndarray:
    return np.array(
        [[*c.ap_at.values(), c.ate, c.ase, c.aoe, c.num_truth, c.num_predictions] for c in metrics.classes.values()]
    )


@settings(max_examples=80, deadline=None)
@given(tables())
def test_equals_the_plain_loops(pair):
    fast, slow = evaluate(*pair, PROTOCOL), evaluate_slowly(*pair, PROTOCOL)
    np.testing.assert_allclose(numbers(fast), numbers(slow), rtol=0, atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(tables(), st.floats(0, 0.9), st.floats(0, 0.9), st.sampled_from([(0.3, 3.0), (3.0, 0.3), (1.0,)]))
def test_equals_the_plain_loops_under_any_protocol(pair, min_recall, min_precision, thresholds):
    protocol = Protocol(
        min_recall=min_recall, min_precision=min_precision, distance_thresholds_m=thresholds, tp_threshold_m=thresholds[0]
    )
    np.testing.assert_allclose(numbers(evaluate(*pair, protocol)), numbers(evaluate_slowly(*pair, protocol)), rtol=0, atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(tables(score_steps=(None,)), st.randoms(use_true_random=False))
def test_order_of_samples_and_rows_does_not_matter(pair, random):
    """As long as scores differ: the order of equal scores is defined by the order of rows."""
    truth, predictions = pair
    tokens = list(truth)
    random.shuffle(tokens)
    rng = np.random.default_rng(random.randrange(2**32))
    shuffled = [{t: table[t][rng.permutation(len(table[t]))] for t in tokens} for table in (truth, predictions)]
    np.testing.assert_allclose(numbers(evaluate(*pair, PROTOCOL)), numbers(evaluate(*shuffled, PROTOCOL)), rtol=0, atol=1e-12)


@settings(max_examples=40, deadline=None)
@given(tables(), st.floats(-np.pi, np.pi), st.lists(st.floats(-100, 100), min_size=3, max_size=3))
def test_moving_everything_changes_nothing(pair, yaw, shift):
    c, s = np.cos(yaw), np.sin(yaw)
    world_from_ego = Pose(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), np.array(shift))
    moved = [{t: boxes.transformed(world_from_ego) for t, boxes in table.items()} for table in pair]
    np.testing.assert_allclose(numbers(evaluate(*pair, PROTOCOL)), numbers(evaluate(*moved, PROTOCOL)), rtol=0, atol=1e-6)


@settings(max_examples=40, deadline=None)
@given(tables(), st.sampled_from(PROTOCOL.classes))
def test_a_least_confident_false_positive_never_raises_ap(pair, name):
    truth, predictions = pair
    token = next(iter(predictions))
    # 0 is below every other score or, among equals, last in turn because it is the first row
    ghost = Boxes3D.create([[500.0, 500.0, 0.0]], [[1, 1, 1]], [0], [name], scores=[0])
    more = {**predictions, token: Boxes3D.concatenate([ghost, predictions[token]])}
    before, after = evaluate(*pair, PROTOCOL), evaluate(truth, more, PROTOCOL)
    for c in PROTOCOL.classes:
        for threshold_m, ap in after.classes[c].ap_at.items():
            assert ap <= before.classes[c].ap_at[threshold_m] + 1e-12
    assert after.classes[name].num_predictions == before.classes[name].num_predictions + 1


@settings(max_examples=40, deadline=None)
@given(tables())
def test_numbers_stay_in_their_ranges(pair):
    metrics = evaluate(*pair, PROTOCOL)
    for c in metrics.classes.values():
        assert all(0 <= ap <= 1 + 1e-12 for ap in c.ap_at.values())
        assert 0 <= c.ate <= PROTOCOL.tp_threshold_m and 0 <= c.ase <= 1 and 0 <= c.aoe <= np.pi + 1e-12
    assert 0 <= metrics.nds_star <= 1 + 1e-12


@settings(max_examples=20, deadline=None)
@given(tables(), st.floats(0.1, 1))
def test_only_the_order_of_scores_enters_ap(pair, power):
    truth, predictions = pair
    bent = {token: replace(boxes, scores=boxes.scores**power) for token, boxes in predictions.items()}
    assert evaluate(truth, bent, PROTOCOL).mean_ap == pytest.approx(evaluate(truth, predictions, PROTOCOL).mean_ap, abs=1e-12)
