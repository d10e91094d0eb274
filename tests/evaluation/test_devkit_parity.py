"""AP and true-positive errors equal those of nuscenes-devkit, which runs in an environment of its own."""

from __future__ import annotations

import json
import os
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from box_tables import random_detections, random_truth

from coin3d.evaluation import Protocol, evaluate
from coin3d.evaluation.results_json import write_results
from coin3d.geometry import Boxes3D, Pose

Tables = tuple[dict[str, Boxes3D], dict[str, Boxes3D]]
REPOSITORY = Path(__file__).resolve().parents[2]
DEVKIT_PYTHON = Path(os.environ.get("COIN3D_DEVKIT_PYTHON", REPOSITORY / ".venv-devkit/bin/python"))

pytestmark = pytest.mark.skipif(
    not DEVKIT_PYTHON.exists(),
    reason=f"no devkit environment at {DEVKIT_PYTHON}: python3 -m venv .venv-devkit && "
    ".venv-devkit/bin/pip install --no-deps -r tests/evaluation/devkit-requirements.txt",
)


def plain() -> Tables:
    rng = np.random.default_rng(1)
    truth = random_truth(rng, 200, 12)
    return truth, random_detections(rng, truth)


def many_equal_scores() -> Tables:
    rng = np.random.default_rng(2)
    truth = random_truth(rng, 200, 12)
    return truth, random_detections(rng, truth, score_step=0.1)


def one_score_for_all() -> Tables:
    truth, predictions = plain()
    return truth, {token: replace(boxes, scores=np.full(len(boxes), 0.5)) for token, boxes in predictions.items()}


def scores_of_zero() -> Tables:
    """The devkit reads a score of zero as a recall that was not reached."""
    rng = np.random.default_rng(3)
    truth = random_truth(rng, 200, 12)
    return truth, random_detections(rng, truth, score_step=1.0)


def predictions_in_another_order() -> Tables:
    rng = np.random.default_rng(4)
    truth = random_truth(rng, 200, 12)
    predictions = random_detections(rng, truth, score_step=0.1)
    return truth, {token: predictions[token] for token in rng.permutation(list(predictions)).tolist()[:150]}


def a_class_without_truth() -> Tables:
    rng = np.random.default_rng(5)
    truth = random_truth(rng, 200, 12, classes=("car", "pedestrian"))
    return truth, random_detections(rng, truth)


def a_class_without_predictions() -> Tables:
    rng = np.random.default_rng(6)
    truth = random_truth(rng, 200, 12)
    predictions = random_detections(rng, truth)
    return truth, {token: boxes[boxes.labels != "pedestrian"] for token, boxes in predictions.items()}


def many_samples_without_truth() -> Tables:
    rng = np.random.default_rng(7)
    truth = random_truth(rng, 200, 1)
    return truth, random_detections(rng, truth, false_per_sample=10)


def max_recall_below_a_tenth() -> Tables:
    rng = np.random.default_rng(8)
    truth = random_truth(rng, 200, 12)
    return truth, random_detections(rng, truth, found=0.05, twice=0.0, false_per_sample=1)


def max_recall_around_a_tenth() -> Tables:
    """Exactly 10, 11 and 12 of 100 objects are found."""
    truth, predictions = {}, {}
    for i in range(100):
        centre = np.array([[0.3 * i - 15, y, 1.0] for y in (-20.0, 0.0, 20.0)])
        labels = np.array(["car", "pedestrian", "two-wheel"])
        found = i < np.array([10, 11, 12])
        truth[f"sample {i}"] = Boxes3D.create(centre, np.ones((3, 3)), np.zeros(3), labels)
        predictions[f"sample {i}"] = Boxes3D.create(
            centre + np.array([0.01 * i, 0, 0]),
            np.full((3, 3), 1 + 0.01 * i),
            np.full(3, 0.02 * i),
            labels,
            scores=np.full(3, (i + 1) / 100),
        )[found]
    return truth, predictions


def crowds() -> Tables:
    """Detections fight for objects closer to each other than the thresholds."""
    rng = np.random.default_rng(9)
    truth = random_truth(rng, 200, 15)
    predictions = random_detections(rng, truth, found=0.9, twice=0.5, score_step=0.05)

    def shrink(boxes: Boxes3D) -> Boxes3D:
        return replace(boxes, centre_m=boxes.centre_m * 0.1)

    return {t: shrink(b) for t, b in truth.items()}, {t: shrink(b) for t, b in predictions.items()}


def nothing_found() -> Tables:
    rng = np.random.default_rng(10)
    truth = random_truth(rng, 20, 5)
    return truth, {token: Boxes3D.empty() for token in truth}


SCENARIOS = (
    plain,
    many_equal_scores,
    one_score_for_all,
    scores_of_zero,
    predictions_in_another_order,
    a_class_without_truth,
    a_class_without_predictions,
    many_samples_without_truth,
    max_recall_below_a_tenth,
    max_recall_around_a_tenth,
    crowds,
    nothing_found,
)


def _json(table: dict[str, Boxes3D]) -> dict[str, list[dict[str, object]]]:
    return {
        token: [
            {"name": str(name), "centre": centre.tolist(), "size_lwh": size.tolist(), "yaw": float(yaw), "score": float(score)}
            for name, centre, size, yaw, score in zip(
                boxes.labels, boxes.centre_m, boxes.size_m, boxes.yaw_rad, boxes.scores, strict=True
            )
        ]
        for token, boxes in table.items()
    }


@pytest.fixture(scope="module")
def devkit_results() -> dict[str, dict[str, dict[str, list[float]]]]:
    tables = [scenario() for scenario in SCENARIOS]
    request = json.dumps([{"truth": _json(truth), "predictions": _json(predictions)} for truth, predictions in tables])
    oracle = Path(__file__).with_name("devkit_oracle.py")
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    done = subprocess.run([DEVKIT_PYTHON, oracle], input=request, capture_output=True, text=True, env=clean, check=False)
    assert done.returncode == 0, done.stderr
    return dict(zip((s.__name__ for s in SCENARIOS), json.loads(done.stdout), strict=True))


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda s: s.__name__)
def test_equals_the_devkit(scenario, devkit_results):
    metrics = evaluate(*scenario(), Protocol())
    expected = devkit_results[scenario.__name__]
    for name, ours in metrics.classes.items():
        np.testing.assert_allclose(list(ours.ap_at.values()), expected[name]["ap"], rtol=0, atol=1e-6, err_msg=name)
        np.testing.assert_allclose([ours.ate, ours.ase, ours.aoe], expected[name]["errors"], rtol=0, atol=1e-6, err_msg=name)


def test_scenarios_are_what_they_say(devkit_results):
    """A parity of zeros would prove little."""
    for name in ("plain", "many_equal_scores", "one_score_for_all", "scores_of_zero", "predictions_in_another_order", "crowds"):
        for result in devkit_results[name].values():
            assert 0.03 < np.mean(result["ap"]) < 0.9 and max(result["errors"]) != 1
    assert {c: round(r["max_recall"], 2) for c, r in devkit_results["max_recall_around_a_tenth"].items()} == {
        "car": 0.1,
        "pedestrian": 0.11,
        "two-wheel": 0.12,
    }
    assert all(r["max_recall"] < 0.1 for r in devkit_results["max_recall_below_a_tenth"].values())
    assert devkit_results["a_class_without_truth"]["two-wheel"] == {"ap": [0] * 4, "errors": [1] * 3, "max_recall": 0}


def test_order_of_equal_scores_matters():
    """The parity of ties is not vacuous: reversed rows of one score give another AP."""
    truth, predictions = one_score_for_all()
    backwards = {token: boxes[::-1] for token, boxes in reversed(predictions.items())}
    assert evaluate(truth, predictions, Protocol()).mean_ap != evaluate(truth, backwards, Protocol()).mean_ap


def test_devkit_reads_what_we_write(tmp_path):
    """Its own loader accepts the file, and the heading and size it reads are ours."""
    truth, _ = plain()
    pose = Pose.from_euler(0.5, 0, 0, [10, 20, 0])
    write_results(tmp_path / "results.json", ((token, pose, boxes) for token, boxes in truth.items()))
    code = (
        "import json, sys; sys.path.insert(0, sys.argv[1]); import devkit_oracle as d\n"
        "from nuscenes.eval.common.utils import quaternion_yaw; from pyquaternion import Quaternion\n"
        "read = d.EvalBoxes.deserialize(json.load(open(sys.argv[2]))['results'], d.DetectionBox)\n"
        "rows = [[*b.translation, *b.size, quaternion_yaw(Quaternion(b.rotation)), b.detection_score] for b in read.all]\n"
        "json.dump(rows, sys.stdout)"
    )
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    command = [DEVKIT_PYTHON, "-c", code, Path(__file__).parent, tmp_path / "results.json"]
    done = subprocess.run(command, capture_output=True, text=True, env=clean, check=False)
    assert done.returncode == 0, done.stderr
    boxes = Boxes3D.concatenate(truth.values()).transformed(pose)
    ours = np.column_stack([boxes.centre_m, boxes.size_m[:, [1, 0, 2]], boxes.yaw_rad, boxes.scores])
    np.testing.assert_allclose(json.loads(done.stdout), ours, rtol=0, atol=1e-9)
