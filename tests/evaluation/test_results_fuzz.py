"""Damaged results files of the detection task: boxes with values that make no sense, endless and cut-off texts."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from coin3d.datasets.classes import THREE_CLASS
from coin3d.evaluation.box_table import BoxTable
from coin3d.evaluation.results_json import read_results
from coin3d.geometry import Pose
from fuzzing import broken_json, damaged, refused

EGO = {"a": Pose.from_euler(1.0, 0.01, 0.0, [600.0, 1600, 5]), "b": Pose.identity()}


def box(token: str, x: float) -> dict[str, object]:
    return {
        "sample_token": token,
        "translation": [x, 2.0, 1.0],
        "size": [2.0, 4.5, 1.6],
        "rotation": [0.8, 0.0, 0.0, 0.6],
        "velocity": [0.0, 0.0],
        "detection_name": "car",
        "detection_score": 0.5,
        "attribute_name": "",
    }


CONTENT = {"meta": {"use_camera": True}, "results": {"a": [box("a", 600.0), box("a", 610.0)], "b": [box("b", 10.0)]}}


def read(path: Path) -> BoxTable:
    return read_results(path, EGO, THREE_CLASS)


def test_values_that_make_no_sense(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    path = tmp_path / "results.json"
    path.write_text(json.dumps(CONTENT))
    truth = read(path)
    complaints = 0
    for _ in range(300):
        text, changed_type = broken_json(CONTENT, rng)
        path.write_text(text)
        table = refused(lambda: read(path), str(path))
        complaints += table is None
        if table is not None:
            assert all(np.isfinite(column).all() for column in (table.centre_m, table.size_m, table.yaw_rad, table.score))
            assert (table.size_m > 0).all()
        if table is not None and changed_type:
            assert table.tokens == truth.tokens and np.array_equal(table.start, truth.start)
            np.testing.assert_array_equal(table.centre_m, truth.centre_m)
    assert 100 < complaints < 300


def test_files_cut_off_or_flipped(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    path = tmp_path / "results.json"
    whole = json.dumps(CONTENT).encode()
    for _ in range(300):
        path.write_bytes(damaged(whole, rng))
        refused(lambda: read(path), str(path))


@pytest.mark.parametrize(
    "text",
    [
        '{"results": {"a": [{"translation": [1e308, 1e308, 1e308], "size": [1, 1, 1], "rotation": [1, 0, 0, 0], '
        '"detection_name": "car", "detection_score": 0.5}]}}',
        '{"results": {"a": [{"translation": [0, 0, 0], "size": [1, 1, 1], "rotation": [1e200, 1e200, 0, 0], '
        '"detection_name": "car", "detection_score": 0.5}]}}',
        '{"results": ' * 50_000,
        '{"results": {"a": "' + "x" * 200_000,
        '{"' + "k" * 200_000 + '": 1}',
        '{"results": {"a": [' + "{}," * 50_000 + "{}]}}",
        '{"results": {"a": [], "\\ud800": []}}',
    ],
)
def test_texts_that_ask_for_trouble(tmp_path: Path, text: str) -> None:
    path = tmp_path / "results.json"
    path.write_text(text)
    assert refused(lambda: read(path), str(path)) is None


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("size", [2.0, True, 1.6]),
        ("translation", [600.0, 2.0, False]),
        ("rotation", [True, 0.0, 0.0, 0.0]),
        ("detection_score", True),
        ("translation", [-(2**63), 2, 1]),
        ("translation", [2**63, 2, 1]),
        ("translation", [1e13, 2.0, 1.0]),
    ],
)
def test_values_that_numpy_would_take_for_numbers(tmp_path: Path, field: str, value: object) -> None:
    """Among numbers ``true`` would become 1, and the smallest whole number has no absolute value."""
    path = tmp_path / "results.json"
    path.write_text(json.dumps({"results": {"a": [box("a", 600.0), {**box("a", 600.0), field: value}]}}))
    with pytest.raises(ValueError, match=rf"results\.json: sample 'a': box 1 has the {field}"):
        read(path)
