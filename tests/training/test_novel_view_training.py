"""Training on rendered views from folders: both methods, resumable settings, checkpoints that need no Gaussians."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from coin3d import cli
from coin3d.augmentation import NovelViewOptions, RigSampler
from coin3d.datasets.classes import MERGED_CAR
from coin3d.datasets.open import open_recording
from coin3d.detectors import BEVDepthConfig
from coin3d.methods import CoIn3DOptions, DirectOptions, NoOptions
from coin3d.rendering import Gaussians, save_gaussians
from coin3d.training.checkpoint import load_checkpoint
from coin3d.training.options import TrainOptions
from coin3d.training.train import train
from small_world import CONFIG

OPTIONS = TrainOptions(steps=2, batch_size=1, workers=0, warmup_steps=0)
ALWAYS = NovelViewOptions(probability=1.0)


@pytest.fixture
def gaussians(tiny_recording: Path, tmp_path: Path) -> Path:
    """A grey sphere around every frame."""
    rng = np.random.default_rng(0)
    direction = rng.normal(size=(3000, 3))
    centre = 20 * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    colour = rng.integers(60, 200, (3000, 3)).astype(np.uint8)
    for frame in open_recording(tiny_recording):
        ball = Gaussians(centre.astype(np.float32), np.full(3000, 0.8, np.float32), colour)
        save_gaussians(tmp_path / "gaussians" / frame.scene / f"{frame.token}.safetensors", ball)
    return tmp_path / "gaussians"


def run(data: Path, out: Path, method: str, method_options: Any, gaussians: Path | None) -> Path:
    return train(
        [data], out, detector="bevdepth", config=CONFIG, method=method, method_options=method_options, class_map=MERGED_CAR,
        options=OPTIONS, gaussians=gaussians, progress=lambda line: None,
    )  # fmt: skip


@pytest.mark.parametrize(("method", "options"), [("coin3d", CoIn3DOptions()), ("direct", DirectOptions())])
def test_views_change_the_run_and_the_checkpoint_stands_alone(
    tiny_recording: Path, gaussians: Path, tmp_path: Path, method: str, options: Any
) -> None:
    weights = run(tiny_recording, tmp_path / "run", method, replace(options, novel_views=ALWAYS), gaussians)
    raw = run(tiny_recording, tmp_path / "raw", method, options, None)
    first, other = ((w.parent / "log.jsonl").read_text().splitlines()[0] for w in (weights, raw))
    assert json.loads(first)["losses"] != json.loads(other)["losses"]
    shutil.rmtree(gaussians)
    model, description = load_checkpoint(weights)
    assert description["options"]["novel_views"]["probability"] == 1.0
    assert model.method.options.novel_views == ALWAYS
    assert str(gaussians) not in json.dumps(description)


def test_what_does_not_fit_together_is_refused_before_anything_is_written(
    tiny_recording: Path, gaussians: Path, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    with pytest.raises(ValueError, match="novel views are rendered from Gaussians: say where they are"):
        run(tiny_recording, out, "direct", DirectOptions(ALWAYS), None)
    with pytest.raises(ValueError, match="method none as it is set renders no novel views"):
        run(tiny_recording, out, "none", NoOptions(), gaussians)
    with pytest.raises(FileNotFoundError, match="no such folder of Gaussians"):
        run(tiny_recording, out, "direct", DirectOptions(ALWAYS), tmp_path / "absent")
    waymo = replace(ALWAYS, sampler=RigSampler.target_aware_waymo())
    with pytest.raises(ValueError, match="target-aware ranges are for the cameras FRONT"):
        run(tiny_recording, out, "direct", DirectOptions(waymo), gaussians)
    assert not out.exists()


def test_the_verb(
    tiny_recording: Path, gaussians: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(BEVDepthConfig, "tiny", classmethod(lambda cls: CONFIG))
    words = ["train", str(tiny_recording), "--steps", "1", "--batch-size", "2", "--workers", "0", "--method", "direct"]
    flags = ["--gaussians", str(gaussians), "--novel-view-probability", "0.8", "--vary-array", "--keep-unseen-boxes"]
    assert cli.main([*words, *flags, "--out", str(tmp_path / "run")]) == 0
    settings = json.loads((tmp_path / "run" / "run.json").read_text())["settings"]
    assert settings["gaussians"] == str(gaussians) and settings["training"]["augment"]["keep_unseen_boxes"] is True
    assert settings["options"]["novel_views"]["probability"] == 0.8
    assert settings["options"]["novel_views"]["sampler"]["array"]["max_cameras"] == 8
    assert cli.main([*words, "--vary-array", "--out", str(tmp_path / "other")]) == 2
    assert "say with --gaussians where the built scenes are" in capsys.readouterr().err
    assert cli.main([*words[:-1], "none", "--gaussians", str(gaussians), "--out", str(tmp_path / "other")]) == 2
    assert "renders no novel views" in capsys.readouterr().err
