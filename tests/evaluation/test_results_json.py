"""Results files: read by hand-computed cases, written and read back, and broken in many ways."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from coin3d.datasets import json_stream
from coin3d.datasets.classes import MERGED_CAR, THREE_CLASS
from coin3d.datasets.json_stream import JsonStream
from coin3d.evaluation.results_json import read_results, write_results
from coin3d.geometry import Boxes3D, Pose

# at (100, 200) in the world, heading for +y
EGO = {"a": Pose.from_euler(np.pi / 2, 0, 0, [100, 200, 5]), "b": Pose.identity()}


def box(token: str = "a", **changes: Any) -> dict[str, Any]:
    """A truck 10 m ahead of the ego of ``a`` and 2 m to its left, heading for the world's -x: left, seen from the ego."""
    return {
        "sample_token": token,
        "translation": [98.0, 210.0, 6.0],
        "size": [2.5, 8.0, 3.0],
        "rotation": [0.0, 0.0, 0.0, 1.0],
        "velocity": [0.0, 0.0],
        "detection_name": "truck",
        "detection_score": 0.25,
        "attribute_name": "vehicle.parked",
        **changes,
    }


def write(path: Path, results: Any, **more: Any) -> Path:
    path.write_text(json.dumps({"meta": {"use_camera": True}, "results": results, **more}))
    return path


def test_a_box_by_hand(tmp_path):
    rows = [box(), box(detection_name="barrier"), box(detection_name="bicycle", size=[1, 2, 1], detection_score=1)]
    table = read_results(write(tmp_path / "r.json", {"b": [], "a": rows}), EGO, THREE_CLASS)
    assert table.tokens == ("b", "a") and table.start.tolist() == [0, 0, 2]
    assert table.classes == ("car", "pedestrian", "two-wheel") and table.label.tolist() == [0, 2]
    np.testing.assert_allclose(table.centre_m[0], [10, 2, 1], atol=1e-12)
    assert table.size_m.tolist() == [[8.0, 2.5, 3.0], [2, 1, 1]] and table.score.tolist() == [0.25, 1]
    assert table.yaw_rad[0] == pytest.approx(np.pi / 2)
    cars = read_results(tmp_path / "r.json", EGO, MERGED_CAR)
    assert len(cars) == 1 and cars.classes == ("car",)


def test_keys_in_any_order_and_unknown_ones(tmp_path):
    path = tmp_path / "r.json"
    path.write_text("\ufeff" + json.dumps({"extra": [1, {"x": "}"}], "results": {"b": [box("b")]}, "meta": None}, indent=2))
    assert len(read_results(path, EGO, MERGED_CAR)) == 1


@pytest.mark.parametrize("chunk", [1, 7, 2**20])
def test_what_is_written_comes_back(tmp_path, monkeypatch, chunk):
    monkeypatch.setattr(json_stream, "_CHUNK", chunk)
    rng = np.random.default_rng(0)
    poses = {f'scene {i} "é"': Pose.from_euler(rng.uniform(-3, 3), 0, 0, rng.uniform(-500, 500, 3)) for i in range(4)}
    boxes = {}
    for i, token in enumerate(poses):
        n = 3 * i
        names = rng.choice(["car", "pedestrian", "two-wheel"], n)
        boxes[token] = Boxes3D.create(
            rng.uniform(-50, 50, (n, 3)), rng.uniform(0.3, 9, (n, 3)), rng.uniform(-3, 3, n), names, scores=rng.random(n)
        )
    path = tmp_path / "new folder" / "r.json"
    write_results(path, ((token, poses[token], boxes[token]) for token in poses))
    assert [p.name for p in path.parent.iterdir()] == ["r.json"]
    table = read_results(path, poses, THREE_CLASS)
    assert table.tokens == tuple(poses)
    for token, expected in boxes.items():
        found = table.boxes_of(token)
        np.testing.assert_allclose(found.centre_m, expected.centre_m, atol=1e-9)
        np.testing.assert_allclose(found.yaw_rad, expected.yaw_rad, atol=1e-9)
        np.testing.assert_array_equal(found.size_m, expected.size_m)
        np.testing.assert_array_equal(found.scores, expected.scores)
        assert found.labels.tolist() == expected.labels.tolist()
    first = next(iter(json.loads(path.read_text())["results"].values()))
    assert first == []


def test_written_fields_are_those_of_the_task(tmp_path):
    moving = Boxes3D.create([[10, 2, 1]], [[2, 1, 1.5]], [np.pi / 2], ["two-wheel"], scores=[0.5], velocity_mps=[[3, 0]])
    write_results(tmp_path / "r.json", [("a", EGO["a"], moving)])
    (row,) = json.loads((tmp_path / "r.json").read_text())["results"]["a"]
    assert set(row) == set(box()) and row["detection_name"] == "motorcycle"
    assert row["translation"] == pytest.approx([98, 210, 6]) and row["size"] == [1, 2, 1.5]
    assert row["velocity"] == pytest.approx([0, 3]), "ahead is the world's +y"
    assert np.abs(row["rotation"]) == pytest.approx([0, 0, 0, 1])


def test_a_class_without_a_name_leaves_no_file(tmp_path):
    good, bad = (Boxes3D.create([[0, 0, 0]], [[1, 1, 1]], [0], [name]) for name in ("car", "SIGN"))
    (tmp_path / "r.json").write_text("the file before")
    with pytest.raises(ValueError, match="sample 'b': class 'SIGN' has no name"):
        write_results(tmp_path / "r.json", [("a", EGO["a"], good), ("b", EGO["b"], bad)])
    assert [p.read_text() for p in tmp_path.iterdir()] == ["the file before"]


@pytest.mark.parametrize(
    ("results", "message"),
    [
        ({"zzz": []}, "sample 'zzz' is not in the recording"),
        ({"a": {}}, "sample 'a': its boxes are a list"),
        ({"a": [3]}, "sample 'a': its boxes are a list"),
        ({"a": [box(), box("b")]}, "sample 'a': box 1 says sample_token 'b'"),
        ({"a": [box(detection_name="tank")]}, "sample 'a': box 0 has the detection_name 'tank'"),
        ({"a": [box(detection_name=7)]}, "detection_name 7"),
        ({"a": [box(), {**box(), "size": [1, 2]}]}, r"sample 'a': box 1 has the size \[1, 2\], .* 3 finite numbers"),
        ({"a": [box(size=[1, 2, "3"])]}, "box 0 has the size"),
        ({"a": [box(size=[1, 0, 3])]}, "sample 'a' has a box of size"),
        ({"a": [box(translation=[1, 2, float("nan")])]}, "box 0 has the translation"),
        ({"a": [box(translation=None)]}, "box 0 has the translation None"),
        ({"a": [box(), box(translation=[1, 2, 10**400])]}, "box 1 has the translation"),
        ({"a": [box(detection_score=True)]}, "detection_score True, which should be a finite number"),
        ({"a": [box(detection_score=[0.5])]}, r"detection_score \[0.5\]"),
        ({"a": [box(rotation=[1, 1, 0, 0])]}, "rotation .* of length 1.41"),
        ({"a": [{k: v for k, v in box().items() if k != "rotation"}]}, "rotation None"),
        ([1, 2], "expected an object"),
    ],
)
def test_boxes_that_make_no_sense_are_named(tmp_path, results, message):
    with pytest.raises(ValueError, match=message) as caught:
        read_results(write(tmp_path / "r.json", results), EGO, THREE_CLASS)
    assert str(tmp_path / "r.json") in str(caught.value)


def test_parts_of_a_recording(tmp_path):
    path = write(tmp_path / "r.json", {"a": [box()], "b": [box("b")]})
    assert read_results(path, {"a": EGO["a"]}, MERGED_CAR, skip_others=True).tokens == ("a",)
    with pytest.raises(ValueError, match="none of its 2 samples"):
        read_results(path, {"c": EGO["a"]}, MERGED_CAR, skip_others=True)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected an object|ends where"),
        ("{}", "no 'results' in it"),
        ('{"results": {"a": [], "a": []}}', "sample 'a' comes twice"),
        ('{"results": {}} {}', "something follows"),
        ('{"results": {} "meta": 1}', "expected ',' or '}'"),
        ('{"results" {}}', "expected ':'"),
        ('{"results": {7: []}}', "a key is a string, got 7"),
        ('{"results": {"a": [' + "[" * 100_000, "recursion|ends within"),
        ('{"results": {"a": [1, nope]}}', "Expecting value"),
        ('{"results": {"a": ' + "9" * 5000 + "}}", "integer"),
        ("\x00\x01", "expected an object"),
    ],
)
def test_what_is_no_results_file_is_refused(tmp_path, text, message):
    path = tmp_path / "r.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        read_results(path, EGO, THREE_CLASS)


def test_files_that_are_cut_short_never_pass(tmp_path):
    whole = write(tmp_path / "whole.json", {"a": [box()], "b": [box("b")]}).read_text()
    path = tmp_path / "cut.json"
    for length in range(0, len(whole) - 1, 5):
        path.write_text(whole[:length])
        with pytest.raises(ValueError, match=r"cut\.json"):
            read_results(path, EGO, THREE_CLASS)


def test_flipped_bytes_end_in_an_error_or_a_table(tmp_path):
    whole = bytearray(write(tmp_path / "r.json", {"a": [box()], "b": [box("b")]}).read_bytes())
    rng = np.random.default_rng(0)
    refused = 0
    for _ in range(150):
        broken = bytearray(whole)
        broken[rng.integers(len(whole))] ^= 1 << int(rng.integers(8))
        (tmp_path / "r.json").write_bytes(broken)
        try:
            read_results(tmp_path / "r.json", EGO, THREE_CLASS)
        except ValueError:
            refused += 1
    assert 50 < refused < 150


def test_a_value_without_end_is_given_up(monkeypatch):
    """After a bounded part of an endless file."""

    class Endless(io.StringIO):
        given = 0

        def read(self, size: int | None = -1) -> str:
            assert size is not None and size > 0
            Endless.given += size
            return "[" + "1," * (size // 2 - 1) + "1" if Endless.given == size else ",1" * (size // 2)

    monkeypatch.setattr(json_stream, "_MAX_VALUE", 2**18)
    monkeypatch.setattr(json_stream, "_CHUNK", 2**12)
    with pytest.raises(ValueError, match="a value of more than 262144 characters"):
        JsonStream(Endless(), Path("endless.json")).value()
    assert Endless.given < 2**21


def test_missing_file(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such results file"):
        read_results(tmp_path / "none.json", EGO, THREE_CLASS)
