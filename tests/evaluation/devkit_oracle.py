"""Score scenarios with nuscenes-devkit. Run by test_devkit_parity.py with a Python that has the devkit.

stdin:  JSON list of {"truth": {token: [box, ...]}, "predictions": {...}}, a box being
        {"name", "centre" [3], "size_lwh" [3], "yaw", "score"}.
stdout: JSON list of {class: {"ap": [one per threshold], "errors": [ATE, ASE, AOE], "max_recall": number}}.
"""

import importlib.util
import json
import math
import sys
from pathlib import Path
from types import ModuleType


def _enter_package_without_its_viewer():
    """Let ``nuscenes.eval`` be imported without matplotlib, OpenCV and scikit-learn, which its metrics never use."""
    spec = importlib.util.find_spec("nuscenes")
    package = ModuleType("nuscenes")
    package.__path__ = [str(Path(spec.origin).parent)]
    sys.modules["nuscenes"] = package
    viewer = ModuleType("nuscenes.utils.data_classes")
    viewer.Box = None
    sys.modules["nuscenes.utils.data_classes"] = viewer


_enter_package_without_its_viewer()

from nuscenes.eval.common.data_classes import EvalBoxes  # noqa: E402
from nuscenes.eval.common.utils import center_distance  # noqa: E402
from nuscenes.eval.detection.algo import accumulate, calc_ap, calc_tp  # noqa: E402
from nuscenes.eval.detection.data_classes import DetectionBox  # noqa: E402

DEVKIT_NAME = {"car": "car", "pedestrian": "pedestrian", "two-wheel": "motorcycle"}
THRESHOLDS_M = (0.5, 1.0, 2.0, 4.0)
TP_THRESHOLD_M = 2.0
MIN_RECALL = MIN_PRECISION = 0.1


def eval_boxes(table):
    boxes = EvalBoxes()
    for token, rows in table.items():
        boxes.add_boxes(token, [detection_box(token, row) for row in rows])
    return boxes


def detection_box(token, row):
    length, width, height = row["size_lwh"]
    return DetectionBox(
        sample_token=token,
        translation=tuple(row["centre"]),
        size=(width, length, height),
        rotation=(math.cos(row["yaw"] / 2), 0.0, 0.0, math.sin(row["yaw"] / 2)),
        detection_name=DEVKIT_NAME[row["name"]],
        detection_score=float(row["score"]),
    )


def score(scenario):
    return metrics(eval_boxes(scenario["truth"]), eval_boxes(scenario["predictions"]))


def metrics(truth, predictions):
    result = {}
    for name, devkit_name in DEVKIT_NAME.items():
        curves = {t: accumulate(truth, predictions, devkit_name, center_distance, t) for t in THRESHOLDS_M}
        at_tp = curves[TP_THRESHOLD_M]
        result[name] = {
            "ap": [calc_ap(curves[t], MIN_RECALL, MIN_PRECISION) for t in THRESHOLDS_M],
            "errors": [calc_tp(at_tp, MIN_RECALL, metric) for metric in ("trans_err", "scale_err", "orient_err")],
            "max_recall": float(at_tp.max_recall),
        }
    return result


if __name__ == "__main__":
    json.dump([score(scenario) for scenario in json.load(sys.stdin)], sys.stdout)
