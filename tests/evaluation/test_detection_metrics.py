"""Cases computed by hand."""

from __future__ import annotations

import numpy as np
import pytest
from box_tables import CLASSES, random_truth

from coin3d.evaluation import Protocol, evaluate, nds_star
from coin3d.geometry import Boxes3D

CARS = Protocol(name="cars", classes=("car",))


def cars(xs, *, scores=None, y=0.0, yaw=0.0, size=(4.0, 2.0, 1.5)) -> Boxes3D:
    n = len(xs)
    return Boxes3D.create(
        np.column_stack([xs, np.full(n, y), np.full(n, 1.0)]),
        np.tile(size, (n, 1)),
        np.full(n, yaw),
        ["car"] * n,
        scores=scores,
    )


def test_truth_as_predictions_is_perfect():
    truth = random_truth(np.random.default_rng(0), 50, 10)
    metrics = evaluate(truth, truth, Protocol())
    assert metrics.mean_ap == pytest.approx(1, abs=1e-12)
    assert (metrics.mean_ate, metrics.mean_ase, metrics.mean_aoe) == pytest.approx((0, 0, 0), abs=1e-12)
    assert metrics.nds_star == pytest.approx(1, abs=1e-12)
    assert metrics.num_truth == metrics.num_predictions == sum(map(len, truth.values()))
    assert metrics.num_samples == 50


def test_two_cars_one_found():
    """One of two cars is found, no false positive: precision 1 up to recall 0.5, nothing beyond.

    Of the recalls 0.11 .. 1.00 (90 of them), those up to 0.50 (40) have precision 1 - 0.1: AP = 40/90.
    The only match is 0.6 m off, turned by 0.3 rad, and twice as long: IoU 0.5.
    """
    truth = {"a": cars([0.0, 20.0])}
    found = {"a": cars([0.6], scores=[0.9], yaw=0.3, size=(8.0, 2.0, 1.5))}
    result = evaluate(truth, found, CARS).classes["car"]
    expected = 40 / 90
    assert result.ap_at == pytest.approx({0.5: 0, 1.0: expected, 2.0: expected, 4.0: expected})
    assert result.ap == pytest.approx(3 / 4 * expected)
    assert (result.ate, result.ase, result.aoe) == pytest.approx((0.6, 0.5, 0.3))
    assert result.nds_star == pytest.approx((3 * 3 / 4 * expected + 0.4 + 0.5 + 0.7) / 6)


def test_false_positive_first_then_both_found():
    """Ranked miss, hit, hit: recall 0, 1/2, 1 and precision 0, 1/2, 2/3, joined by straight lines.

    Precision at recall r is r up to 1/2 and 1/2 + (r - 1/2)/3 beyond. Translation errors 0 then 1: the running mean is
    0 at score 0.8 and 1/2 at score 0.7. Recall r has the score 0.8 - 0.1 (r - 1/2)/(1/2) beyond 1/2, and the error
    at that score is r - 1/2; below 1/2 the error is 0.
    """
    truth = {"a": cars([0.0]), "b": cars([10.0])}
    predictions = {"a": cars([30.0, 0.0], scores=[0.9, 0.8]), "b": cars([11.0], scores=[0.7])}
    result = evaluate(truth, predictions, CARS).classes["car"]
    r = np.arange(11, 101) / 100
    precision = np.where(r <= 0.5, r, 0.5 + (r - 0.5) / 3)
    assert result.ap_at[2.0] == pytest.approx(np.mean(precision - 0.1) / 0.9)
    assert result.ate == pytest.approx(np.mean(np.maximum(r - 0.5, 0)))


def test_confident_detection_takes_the_nearest_free_object():
    """Both detections sit at the first object; the second must go to the other, 2.9 m away, or is false.

    At 2 m: precision 1 up to recall 0.49 and, at 0.50, the 1/2 after the false positive at the same recall.
    """
    truth = {"a": cars([0.0, 3.0])}
    predictions = {"a": cars([0.2, 0.1], scores=[0.9, 0.8])}
    result = evaluate(truth, predictions, CARS).classes["car"]
    assert result.ap_at[4.0] == pytest.approx(1)
    assert result.ap_at[2.0] == pytest.approx((39 * 0.9 + 0.4) / 90 / 0.9)


def test_distance_equal_to_the_threshold_is_no_match():
    assert evaluate({"a": cars([0.0])}, {"a": cars([2.0], scores=[1])}, CARS).classes["car"].ap_at[2.0] == 0


def test_height_and_class_do_not_match_across():
    truth = {"a": cars([0.0])}
    high = Boxes3D.create([[0, 0, 50.0]], [[4, 2, 1.5]], [0], ["car"])
    assert evaluate(truth, {"a": high}, CARS).mean_ap == pytest.approx(1), "only xy counts"
    walker = high.with_labels(["pedestrian"])
    assert evaluate(truth, {"a": walker}, Protocol()).mean_ap == 0


@pytest.mark.parametrize(
    ("yaw_truth", "yaw_found", "expected"), [(3.1, -3.1, 2 * np.pi - 6.2), (0, np.pi, np.pi), (1, 0.5, 0.5)]
)
def test_orientation_error_wraps_at_a_full_turn(yaw_truth, yaw_found, expected):
    result = evaluate({"a": cars([0.0], yaw=yaw_truth)}, {"a": cars([0.0], yaw=yaw_found)}, CARS)
    assert result.mean_aoe == pytest.approx(expected)


def test_later_of_equal_scores_goes_first():
    """One hit and one miss tie. Hit last, so first in turn: precision 1 up to recall 0.99, then 1/2.

    Miss first in turn: precision rises from 0 to 1/2 along r/2, and counts above 0.1.
    """
    truth = {"a": cars([0.0])}
    hit_last = evaluate(truth, {"a": cars([30.0, 0.0], scores=[0.5, 0.5])}, CARS)
    assert hit_last.mean_ap == pytest.approx((89 * 0.9 + 0.4) / 90 / 0.9)
    hit_first = evaluate(truth, {"a": cars([0.0, 30.0], scores=[0.5, 0.5])}, CARS)
    r = np.arange(11, 101) / 100
    assert hit_first.mean_ap == pytest.approx(np.maximum(r / 2 - 0.1, 0).mean() / 0.9)


def test_without_predictions_or_truth():
    truth = {"a": cars([0.0]), "b": Boxes3D.empty()}
    for predictions in ({}, {"a": Boxes3D.empty()}):
        metrics = evaluate(truth, predictions, CARS)
        assert (metrics.mean_ap, metrics.mean_ate, metrics.mean_ase, metrics.mean_aoe) == (0, 1, 1, 1)
        assert metrics.nds_star == 0 and metrics.num_truth == 1
    metrics = evaluate({"a": Boxes3D.empty()}, {"a": cars([0.0])}, CARS)
    assert (metrics.mean_ap, metrics.nds_star, metrics.num_predictions) == (0, 0, 1)
    assert evaluate({}, {}, Protocol()).nds_star == 0


def test_classes_without_truth_count_as_zero():
    metrics = evaluate({"a": cars([0.0])}, {"a": cars([0.0])}, Protocol())
    assert metrics.mean_ap == pytest.approx(1 / 3) and metrics.mean_ate == pytest.approx(2 / 3)


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        ((0.552, 0.528, 0.148, 0.085), 0.649),  # oracle
        ((0.040, 1.303, 0.265, 0.790), 0.178),  # direct transfer: an error above 1 gives nothing, not less than nothing
        ((0.045, 1.301, 0.253, 0.773), 0.185),
        ((0.381, 0.687, 0.220, 0.155), 0.513),  # CoIn3D
        ((0.014, 1.0, 1.0, 1.0), 0.007),
    ],
)
def test_nds_star_of_rows_of_the_paper(row, expected):
    """Table main_exp_bevdepth_compact, printed to three digits."""
    assert nds_star(*row) == pytest.approx(expected, abs=1e-3)


def test_min_recall_and_precision_shift_the_grid():
    """With both at 0, half the cars found without a false positive gives AP = 50/100."""
    loose = Protocol(classes=("car",), min_recall=0.0, min_precision=0.0)
    assert evaluate({"a": cars([0.0, 20.0])}, {"a": cars([0.0])}, loose).mean_ap == pytest.approx(0.5)


def test_predictions_that_cannot_be_scored_are_refused():
    truth = {"a": cars([0.0])}
    with pytest.raises(ValueError, match=r"1 of 1 predicted samples .* 'zzz'"):
        evaluate(truth, {"zzz": cars([0.0])}, CARS)
    with pytest.raises(ValueError, match=r"sample 'a' .* class 'truck'"):
        evaluate(truth, {"a": cars([0.0]).with_labels(["truck"])}, CARS)
    with pytest.raises(ValueError, match=r"scores from -3 to 2"):
        evaluate(truth, {"a": cars([0.0, 1.0], scores=[-3, 2])}, CARS)


def test_truth_of_other_classes_is_ignored():
    truth = {"a": Boxes3D.concatenate([cars([0.0]), cars([9.0]).with_labels(["barrier"])])}
    metrics = evaluate(truth, {"a": cars([0.0])}, CARS)
    assert metrics.num_truth == 1 and metrics.mean_ap == pytest.approx(1)


def test_unified_classes_are_the_default():
    assert Protocol().classes == CLASSES
