"""Tables in columns: their checks, and filters equal to those of one sample at a time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from box_tables import random_detections, random_truth

from coin3d.evaluation import BoxTable, Protocol, filter_predictions, filter_truth, match, prediction_table, truth_table
from coin3d.evaluation.table_filters import counted_predictions, counted_truth
from coin3d.evaluation.visibility import seen_by_any, seen_by_camera
from coin3d.geometry import Boxes3D, Rig, preset_rig
from coin3d.native import match_boxes

PROTOCOL = Protocol()


def random_rigs(tokens, seed: int = 0) -> dict[str, Rig]:
    """Rigs of different cameras; some samples lack some."""
    rng = np.random.default_rng(seed)
    presets = [preset_rig(name) for name in ("nuscenes", "waymo", "lyft1")]
    rigs = {}
    for token in tokens:
        cameras = dict(presets[rng.integers(3)].cameras)
        for name in list(cameras)[: rng.integers(0, 3)]:
            del cameras[name]
        rigs[token] = Rig(cameras)
    return rigs


def rows(boxes: Boxes3D) -> np.ndarray:
    return np.column_stack([boxes.centre_m, boxes.size_m, boxes.yaw_rad, boxes.scores])


def test_boxes_come_back_as_they_went_in():
    truth = random_truth(np.random.default_rng(0), 20, 5)
    table = BoxTable.from_boxes(truth, ("car", "pedestrian"))
    assert len(table) == sum(map(len, truth.values())) and table.tokens == tuple(truth)
    assert table.number_of("car") == sum((boxes.labels == "car").sum() for boxes in truth.values())
    for token, boxes in truth.items():
        kept = boxes[boxes.labels != "two-wheel"]
        np.testing.assert_array_equal(rows(table.boxes_of(token)), rows(kept))
        assert table.boxes_of(token).labels.tolist() == kept.labels.tolist()
    assert len(table.boxes_of("elsewhere")) == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"yaw_rad": np.array([0, 0, np.nan])}, "sample 'b' has a box with a yaw_rad that is not finite"),
        ({"size_m": np.array([[1, 1, 1], [1, 1, 1], [1, 0, 1.0]])}, r"sample 'b' .* \[1.0, 0.0, 1.0\]"),
        ({"tokens": ("a", "a")}, "names a sample twice"),
        ({"start": np.array([0, 2, 4])}, "borders that do not fit"),
        ({"start": np.array([0, 4, 3])}, "borders that do not fit"),
        ({"label": np.array([0, 0, 1])}, r"labels are -1 \.\. 0"),
        ({"score": np.ones(2)}, "score of shape"),
        ({"num_lidar_points": np.ones(2, dtype=int)}, "num_lidar_points"),
        ({"visibility": np.ones(2, dtype=int)}, "2 rows of visibility"),
    ],
)
def test_columns_that_do_not_fit_are_refused(change, message):
    good = BoxTable(
        ("a", "b"), np.array([0, 2, 3]), ("car",), np.zeros(3), np.zeros((3, 3)), np.ones((3, 3)), np.zeros(3), np.ones(3)
    )
    with pytest.raises(ValueError, match=message):
        replace(good, **change)


@pytest.mark.parametrize("range_shape", ["radial", "square"])
def test_filters_are_those_of_single_samples(range_shape):
    rng = np.random.default_rng(1)
    protocol = replace(PROTOCOL, range_shape=range_shape, max_boxes_per_sample=6)
    truth = {
        token: replace(boxes, num_lidar_points=rng.integers(-1, 2, len(boxes)))
        for token, boxes in random_truth(rng, 60, 12).items()
    }
    predictions = random_detections(rng, truth, score_step=0.1)
    rigs = random_rigs(truth)
    kept_truth = counted_truth(truth_table(truth, protocol), rigs, protocol)
    kept_predictions = counted_predictions(prediction_table(predictions, protocol), rigs, protocol)
    dropped = 0
    for token in truth:
        np.testing.assert_array_equal(rows(kept_truth.boxes_of(token)), rows(filter_truth(truth[token], rigs[token], protocol)))
        expected = filter_predictions(predictions[token], rigs[token], protocol)
        np.testing.assert_array_equal(rows(kept_predictions.boxes_of(token)), rows(expected))
        dropped += len(predictions[token]) - len(expected)
    assert dropped > 50 and kept_truth.number_of("car") > 10, "otherwise this shows little"


def test_cameras_see_what_they_see_sample_by_sample():
    truth = random_truth(np.random.default_rng(2), 40, 12)
    table, rigs = truth_table(truth, PROTOCOL), random_rigs(truth, 3)
    by_name = dict(seen_by_camera(table, rigs))
    assert set(by_name) == {name for rig in rigs.values() for name in rig}
    centre = np.concatenate([boxes.centre_m for boxes in truth.values()])
    for name, seen in by_name.items():
        own = [
            rigs[t][name].sees(boxes.centre_m) if name in rigs[t].cameras else np.zeros(len(boxes), dtype=bool)
            for t, boxes in truth.items()
        ]
        np.testing.assert_array_equal(seen, np.concatenate(own))
    assert len(centre) == len(table)
    np.testing.assert_array_equal(seen_by_any(table, rigs), np.logical_or.reduce(list(by_name.values())))
    with pytest.raises(ValueError, match="40 samples have no rig, the first is 'sample 0'"):
        seen_by_any(table, {})


def test_tables_of_other_classes_do_not_match():
    table = BoxTable.from_boxes({"a": Boxes3D.empty()}, ("car",))
    with pytest.raises(ValueError, match=r"has the classes \['car'\]"):
        match(table, table, PROTOCOL)


def test_native_matching_checks_its_arguments():
    def call(start, label=0, sample=0, columns=1):
        one = np.zeros((1, 3))
        names = np.array([label], dtype=np.int16)
        groups = np.array(start, dtype=np.int64)
        out = np.zeros((columns, 1), dtype=np.int32)
        whole = np.array([0, 1], dtype=np.int64)
        samples = np.full(len(start) - 1, sample, dtype=np.int64)
        match_boxes(one, np.ones(1), names, groups, samples, one, names, whole, 1, np.array([1.0]), out)
        return out

    assert call([0, 1]).tolist() == [[0]]
    for wrong in ({"start": [0, 2]}, {"start": [1, 1]}, {"start": [0, 5, 1]}, {"start": [0, 1], "label": 1}):
        with pytest.raises(ValueError):
            call(**wrong)
    for wrong in ({"sample": 1}, {"sample": -1}, {"columns": 2}):
        with pytest.raises(ValueError):
            call([0, 1], **wrong)
