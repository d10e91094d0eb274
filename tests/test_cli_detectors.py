"""The verbs with every detector: pre-train a trunk, start detectors from it, detect and score."""

from __future__ import annotations

import json
import typing
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

from coin3d import cli
from coin3d.detectors import DETECTORS, BEVFormerConfig
from tiny_recording import write_recording

SHORT = ["--steps", "1", "--batch-size", "1", "--workers", "0", "--cameras-per-sample", "2"]


def result(out: Path) -> dict[str, typing.Any]:
    return json.loads((out / "result.json").read_text())


@pytest.fixture(scope="module")
def trunk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out, data = tmp_path_factory.mktemp("trunk"), write_recording(tmp_path_factory.mktemp("tiny"))
    assert cli.main(["pretrain", str(data), "--out", str(out), *SHORT]) == 0
    assert set(result(out)["last_losses"]) == {"depth", "perspective"} and (out / "curves.png").is_file()
    return out / "model.safetensors"


@pytest.mark.parametrize("detector", DETECTORS)
def test_train_evaluate_detect(detector: str, trunk: Path, tiny_recording: Path, tmp_path: Path) -> None:
    run, data = tmp_path / "run", str(tiny_recording)
    words = ["train", data, "--out", str(run), "--detector", detector, "--trunk", str(trunk), "--backbone-rate", "0", *SHORT]
    assert cli.main(words) == 0
    settings = json.loads((run / "run.json").read_text())["settings"]
    assert settings["options"]["placement"] == ("released" if detector == "bevdepth" else "paper")
    given, kept = load_file(trunk), load_file(run / "model.safetensors")
    convolutions = [name for name in given if name.startswith("backbone.") and given[name].ndim == 4]
    assert len(convolutions) > 8
    for name in convolutions:  # the first one also reads prior maps, behind RGB
        torch.testing.assert_close(kept[name][:, : given[name].shape[1]], given[name])
    assert cli.main(["evaluate", str(run / "model.safetensors"), data, "--out", str(tmp_path / "score"), "--frames", "1"]) == 0
    assert result(tmp_path / "score")["rows"][0]["detector"] == detector
    assert cli.main(["detect", str(run / "model.safetensors"), data, "--out", str(tmp_path / "found"), "--frames", "2"]) == 0
    assert result(tmp_path / "found")["detector"] == detector


def test_a_trunk_does_not_detect(trunk: Path, tiny_recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["detect", str(trunk), str(tiny_recording), "--out", str(tmp_path)]) == 2
    assert "give it to coin3d train --trunk" in capsys.readouterr().err


def test_a_detector_that_looks_back(tiny_recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two frames in training, and in detection of a few frames of the recording as of all."""
    tiny = BEVFormerConfig.tiny()
    monkeypatch.setattr(BEVFormerConfig, "tiny", classmethod(lambda cls: replace(tiny, frames=2)))
    run, data = tmp_path / "run", str(tiny_recording)
    assert cli.main(["train", data, "--out", str(run), "--detector", "bevformer", "--method", "none", *SHORT]) == 0
    boxes = []
    for frames in ("1", "0"):
        out = tmp_path / f"found{frames}"
        assert cli.main(["detect", str(run / "model.safetensors"), data, "--out", str(out), "--frames", frames]) == 0
        boxes.append({f["token"]: f for f in json.loads((out / "detections.json").read_text())["frames"]})
    ((token, alone),) = boxes[0].items()
    assert boxes[1][token] == alone
