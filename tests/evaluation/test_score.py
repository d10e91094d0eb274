from __future__ import annotations

import json
import time

import numpy as np
import pytest
from box_tables import random_detections, random_truth

from coin3d.evaluation import Protocol, evaluate, score
from coin3d.geometry import Boxes3D, preset_rig

RIG = preset_rig("waymo")


def tables(seed: int, num_samples: int):
    rng = np.random.default_rng(seed)
    truth = random_truth(rng, num_samples, 12)
    return truth, random_detections(rng, truth), dict.fromkeys(truth, RIG)


def test_unfiltered_number_counts_what_no_camera_sees():
    """A perfect detector that only looks through the cameras: 1 as scored, less when the blind rear counts."""
    truth, _, rigs = tables(0, 60)
    seen = {token: boxes[RIG.sees(boxes.centre_m)] for token, boxes in truth.items()}
    report = score(truth, seen, rigs, Protocol())
    assert report.metrics.nds_star == pytest.approx(1, abs=1e-12)
    assert report.unfiltered.mean_ap < 0.9
    assert report.unfiltered.num_truth > report.metrics.num_truth > 0
    assert report.unfiltered.num_predictions == report.metrics.num_predictions


def test_row_is_ready_for_json():
    truth, predictions, rigs = tables(1, 30)
    report = score(truth, predictions, rigs, Protocol())
    row = json.loads(json.dumps(report.row(), allow_nan=False))
    assert row["NDS*"] == pytest.approx((3 * row["mAP"] + sum(1 - min(1, row[e]) for e in ("mATE", "mASE", "mAOE"))) / 6)
    assert row["mAP"] == pytest.approx(np.mean([c["AP"] for c in row["classes"].values()]))
    assert list(row["classes"]) == ["car", "pedestrian", "two-wheel"]
    assert row["classes"]["car"]["AP"] == pytest.approx(np.mean(list(row["classes"]["car"]["AP_at"].values())))
    assert row["samples"] == 30 and row["truth_boxes"] == sum(c["truth_boxes"] for c in row["classes"].values())
    assert row["protocol"] == Protocol().describe()
    assert set(row["unfiltered"]) >= {"mAP", "NDS*", "truth_boxes"}


def test_table_shows_every_number_and_the_protocol():
    truth, predictions, rigs = tables(2, 30)
    report = score(truth, predictions, rigs, Protocol())
    lines = report.table().splitlines()
    assert [line.split()[0] for line in lines[:6]] == ["class", "car", "pedestrian", "two-wheel", "mean", "unfiltered"]
    assert len({len(line) for line in lines[:6]}) == 1, "columns line up"
    assert lines[4].split()[-1] == f"{report.metrics.nds_star:.3f}"
    assert lines[5].split()[-1] == f"{report.unfiltered.nds_star:.3f}"
    assert "30 samples" in lines[6] and Protocol().describe() in lines[6]


def test_open_protocol_is_scored_once():
    truth, predictions, rigs = tables(3, 10)
    protocol = Protocol(visible_only=False, drop_zero_lidar=False, range_m=dict.fromkeys(Protocol().classes, 1000.0))
    report = score(truth, predictions, rigs, protocol)
    assert report.unfiltered is report.metrics
    assert report.metrics == evaluate(truth, predictions, protocol)


def test_bad_input_is_named():
    truth, predictions, rigs = tables(4, 3)
    with pytest.raises(ValueError, match="ground truth is empty"):
        score({}, {}, {}, Protocol())
    with pytest.raises(ValueError, match=r"1 samples have no rig, the first is 'sample 1'"):
        score(truth, predictions, {t: r for t, r in rigs.items() if t != "sample 1"}, Protocol())
    unmapped = {t: b.with_labels(np.full(len(b), "vehicle.car")) for t, b in truth.items()}
    with pytest.raises(ValueError, match=r"found vehicle\.car; map"):
        score(unmapped, predictions, rigs, Protocol())
    far_truck = Boxes3D.create([[400, 0, 0]], [[1, 1, 1]], [0], ["truck"])
    with pytest.raises(ValueError, match="class 'truck'"):
        score(truth, {"sample 0": far_truck}, rigs, Protocol())
    with pytest.raises(ValueError, match="not in the ground truth"):
        score(truth, {"sample 99": predictions["sample 0"]}, rigs, Protocol())


def test_a_thousand_full_samples_take_seconds():
    """A validation set is about six times this."""
    rng = np.random.default_rng(5)

    def table(n):
        centre = np.column_stack([rng.uniform(-50, 50, (n, 2)), np.ones(n)])
        labels = rng.choice(Protocol().classes, n)
        return Boxes3D.create(centre, rng.uniform(0.5, 5, (n, 3)), rng.uniform(-3, 3, n), labels, scores=rng.random(n))

    truth = {str(i): table(20) for i in range(1000)}
    predictions = {str(i): table(100) for i in range(1000)}
    start = time.perf_counter()
    evaluate(truth, predictions, Protocol())
    assert time.perf_counter() - start < 4, "0.2 s on an idle core"
