"""Intervals over scenes, against the metric itself and by hand."""

from __future__ import annotations

import numpy as np
import pytest
from box_tables import random_detections, random_truth

from coin3d.evaluation import Matches, Protocol, evaluate, match, prediction_table, truth_table
from coin3d.evaluation import intervals as intervals_module
from coin3d.evaluation.intervals import resample, scene_intervals
from coin3d.evaluation.metrics import metrics_of
from coin3d.geometry import Boxes3D

PROTOCOL = Protocol()
NUM_SCENES = 6


def random_case(seed: int, num_samples: int = 60):
    rng = np.random.default_rng(seed)
    truth = random_truth(rng, num_samples, 8)
    predictions = random_detections(rng, truth)
    return truth, {t: predictions[t] for t in rng.permutation(list(predictions)).tolist()[: num_samples - 5]}


def matched(truth, predictions, protocol=PROTOCOL) -> Matches:
    return match(truth_table(truth, protocol), prediction_table(predictions, protocol), protocol)


def scenes(truth) -> np.ndarray:
    return np.arange(len(truth)) % NUM_SCENES


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("times", [1.0, 3.0])
def test_equal_weights_give_the_metric_itself(seed, times):
    truth, predictions = random_case(seed)
    matches = matched(truth, predictions)
    for name, expected in metrics_of(matches).classes.items():
        ours = resample(matches, name, scenes(truth), np.full((2, NUM_SCENES), times)).columns
        numbers = [expected.ap, expected.ate, expected.ase, expected.aoe, expected.nds_star]
        np.testing.assert_allclose(ours, np.column_stack([numbers, numbers]), rtol=0, atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_scenes_without_weight_might_as_well_not_be_there(seed):
    truth, predictions = random_case(seed)
    kept = [token for token, scene in zip(truth, scenes(truth), strict=True) if scene in (1, 4)]
    part = evaluate({t: truth[t] for t in kept}, {t: b for t, b in predictions.items() if t in kept}, PROTOCOL)
    weights = np.zeros((1, NUM_SCENES))
    weights[0, [1, 4]] = 1
    matches = matched(truth, predictions)
    for name, expected in part.classes.items():
        ours = resample(matches, name, scenes(truth), weights)
        assert ours.ap[0] == pytest.approx(expected.ap, abs=1e-9)
        # scores between the recalls are read off a list that has the other scenes' rows as well
        assert ours.errors[0] == pytest.approx([expected.ate, expected.ase, expected.aoe], abs=0.03)


def test_a_scene_drawn_twice_counts_twice():
    truth, predictions = random_case(7)
    weights = np.array([[2.0, 1, 0, 1, 1, 1]])
    copies = [(t, s, n) for t, s in zip(truth, scenes(truth), strict=True) for n in range(int(weights[0, s]))]
    again = evaluate(
        {f"{t}/{n}": truth[t] for t, _, n in copies},
        {f"{t}/{n}": predictions[t] for t, _, n in copies if t in predictions},
        PROTOCOL,
    )
    for name, expected in again.classes.items():
        ours = resample(matched(truth, predictions), name, scenes(truth), weights)
        assert ours.ap[0] == pytest.approx(expected.ap, abs=0.01)
        assert ours.errors[0] == pytest.approx([expected.ate, expected.ase, expected.aoe], abs=0.03)


def test_curves_through_fewer_hits_are_close(monkeypatch):
    truth, predictions = random_case(8, 150)
    matches, ones = matched(truth, predictions), np.ones((1, NUM_SCENES))
    whole = resample(matches, "car", scenes(truth), ones).columns
    assert int((matches.object_row[2, matches.ranked_rows[0]] >= 0).sum()) > 100
    monkeypatch.setattr(intervals_module, "_MAX_HITS", 50)
    np.testing.assert_allclose(resample(matches, "car", scenes(truth), ones).columns, whole, rtol=0, atol=0.03)


def test_two_scenes_by_hand():
    """A car each; the one is found, the other is not. Both scenes are drawn half of the time, each alone a quarter.

    Found alone AP is 1, missed alone 0, together 40/90 (half the recall without a false positive).
    """

    def car() -> Boxes3D:
        return Boxes3D.create([[10.0, 0, 1]], [[4, 2, 1.5]], [0], ["car"])

    protocol = Protocol(name="cars", classes=("car",))
    matches = matched({"a": car(), "b": car()}, {"a": car()}, protocol)
    scene_of = {"a": "street", "b": "yard"}
    wide = scene_intervals(matches, scene_of)
    assert wide.overall["mAP"] == pytest.approx((0, 1)) and wide.classes["car"]["AP"] == wide.overall["mAP"]
    assert wide.overall["mATE"] == pytest.approx((0, 1)), "a miss alone has the error 1"
    assert wide.overall["NDS*"] == pytest.approx((0, 1))
    middle = scene_intervals(matches, scene_of, level=0.4)
    assert middle.overall["mAP"] == pytest.approx((40 / 90, 40 / 90))
    assert "95% of 1000 draws of 2 scenes" in wide.table() and wide.row()["classes"]["car"]["AP"] == [0.0, pytest.approx(1)]


def test_intervals_hold_the_number_and_repeat():
    truth, predictions = random_case(9)
    matches = matched(truth, predictions)
    scene_of = {token: f"scene {i % 12}" for i, token in enumerate(truth)}
    found = scene_intervals(matches, scene_of, resamples=200)
    metrics = metrics_of(matches)
    for name, value in (("mAP", metrics.mean_ap), ("mATE", metrics.mean_ate), ("NDS*", metrics.nds_star)):
        low, high = found.overall[name]
        assert low < value < high and high - low < 0.5
    assert scene_intervals(matches, scene_of, resamples=200) == found
    assert scene_intervals(matches, scene_of, resamples=200, seed=1) != found
    narrow = scene_intervals(matches, scene_of, resamples=200, level=0.5)
    assert narrow.overall["mAP"][0] > found.overall["mAP"][0] and narrow.overall["mAP"][1] < found.overall["mAP"][1]


def test_without_hits_or_truth():
    nothing = {f"{i}": Boxes3D.empty() for i in range(4)}
    found = scene_intervals(matched(nothing, nothing), {t: t for t in nothing}, resamples=10)
    assert found.overall["mAP"] == (0, 0) and found.overall["mAOE"] == (1, 1) and found.overall["NDS*"] == (0, 0)


def test_what_cannot_be_drawn_is_refused():
    matches = matched({"a": Boxes3D.empty()}, {})
    with pytest.raises(ValueError, match="there is only 1"):
        scene_intervals(matches, {"a": "street"})
    two = matched({"a": Boxes3D.empty(), "b": Boxes3D.empty()}, {})
    with pytest.raises(ValueError, match="level in"):
        scene_intervals(two, {"a": "x", "b": "y"}, level=1.0)
