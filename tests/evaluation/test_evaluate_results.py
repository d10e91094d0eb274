"""``coin3d evaluate`` on a results file: no detector, no database."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from coin3d import cli
from coin3d.datasets.open import open_recording
from coin3d.evaluation.results_json import write_results
from coin3d.geometry import Boxes3D
from tiny_recording import write_recording


@pytest.fixture(scope="module")
def two_streets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(tmp_path_factory.mktemp("streets"), scenes=2, files=True)


def perfect(recording: Path, path: Path, scenes: tuple[str, ...] = ("street-0", "street-1")) -> str:
    """A results file that finds every car of some scenes, and nothing else."""

    def cars(boxes: Boxes3D) -> Boxes3D:
        found = boxes[boxes.labels == "vehicle.car"]
        return found.with_labels(np.full(len(found), "truck"))  # a merged car

    frames = [frame for frame in open_recording(recording) if frame.scene in scenes]
    write_results(path, ((f.token, f.world_from_ego, cars(f.boxes)) for f in frames if f.boxes is not None))
    return str(path)


def run(*words: str) -> int:
    return cli.main(["evaluate", *words])


def test_a_perfect_file(two_streets, tmp_path, capsys):
    out = tmp_path / "out"
    words = ["--out", str(out), "--classes", "merged-car", "--breakdown", "--intervals", "--pictures", "1"]
    assert run(perfect(two_streets, tmp_path / "mine.json"), str(two_streets), *words) == 0
    result = json.loads((out / "result.json").read_text())
    (row,) = result["rows"]
    assert (row["detector"], row["method"], row["target"]) == ("mine", "", two_streets.name)
    assert row["mAP"] == pytest.approx(1) and row["mATE"] == pytest.approx(0, abs=1e-6) and row["truth_boxes"] == 6
    assert row["intervals"]["mAP"] == pytest.approx([1, 1]) and row["intervals"]["scenes"] == 2
    assert set(row["breakdown"]) == {"range", "camera", "length", "LiDAR points", "visibility"}
    assert row["breakdown"]["range"]["0 - 20 m"]["car"]["num_truth"] == 6
    assert row["breakdown"]["camera"]["CAM_FRONT"]["car"]["ap"] == pytest.approx(1)
    told = capsys.readouterr().out
    assert "6 boxes of 6 samples" in told and "by camera" in told and "95% of 1000 draws of 2 scenes" in told
    assert all(Path(picture).is_file() for picture in result["pictures"]) and (out / "curves.png").is_file()


def test_samples_that_are_left_out_count_as_missed(two_streets, tmp_path, capsys):
    out = tmp_path / "out"
    half = perfect(two_streets, tmp_path / "half.json", ("street-1",))
    assert run(half, str(two_streets), "--out", str(out), "--classes", "merged-car", "--pictures", "1") == 0
    assert "it says nothing of 3 samples" in capsys.readouterr().out
    assert json.loads((out / "result.json").read_text())["rows"][0]["mAP"] == pytest.approx(40 / 90)


def test_mistakes_end_in_one_line(two_streets, tmp_path, capsys):
    whole = perfect(two_streets, tmp_path / "mine.json")
    (tmp_path / "cut.json").write_text(Path(whole).read_text()[:-40])
    one_street = write_recording(tmp_path / "one", scenes=1, files=False)
    for words, message in (
        ((str(tmp_path / "none.json"), str(two_streets)), "no such results file"),
        ((str(tmp_path / "cut.json"), str(two_streets)), "cut.json: character"),
        ((whole, str(one_street)), "sample 'sample1.0' is not in the recording"),
        ((whole, str(one_street), "--intervals"), "of a single one"),
    ):
        assert run(*words, "--out", str(tmp_path / "out")) == 2
        assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
