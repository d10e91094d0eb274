"""A run set up from folders: what it leaves behind, and what it refuses before writing anything."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.torch import load_file

from coin3d.datasets.classes import THREE_CLASS
from coin3d.datasets.open import open_recording
from coin3d.methods import METHODS
from coin3d.training.checkpoint import load_checkpoint
from coin3d.training.options import TrainOptions
from coin3d.training.predict import predict
from coin3d.training.train import train
from small_world import CONFIG

OPTIONS = TrainOptions(steps=2, batch_size=1, workers=0, warmup_steps=0)


def run(data: Path, out: Path, **changed: Any) -> Path:
    arguments: dict[str, Any] = {
        "detector": "bevdepth",
        "config": CONFIG,
        "method": "none",
        "method_options": METHODS["none"][0](),
        "class_map": THREE_CLASS,
        "options": OPTIONS,
        "progress": lambda line: None,
    }
    return train([data], out, **{**arguments, **changed})


def test_a_run_leaves_everything_needed_to_repeat_it(tiny_recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    weights = run(tiny_recording, out)
    assert {p.name for p in out.iterdir()} == {"run.json", "log.jsonl", "curves.png", "model.safetensors"}
    record = json.loads((out / "run.json").read_text())
    assert record["settings"]["training"]["seed"] == 0 and record["settings"]["method"] == "none"
    assert len(record["data_fingerprint"]) == 16 and record["versions"]["torch"] != "not installed"
    model, description = load_checkpoint(weights)
    assert description["classes"] == ["car", "pedestrian", "two-wheel"] and "2 steps" in description["notes"]
    recording = open_recording(tiny_recording)
    found = predict(model, [recording[0], recording[1]])
    assert list(found) == [recording[0].token, recording[1].token]
    again = tmp_path / "again"
    assert run(tiny_recording, again).read_bytes() == weights.read_bytes()


def test_a_finished_run_is_left_alone(tiny_recording: Path, tmp_path: Path) -> None:
    weights = run(tiny_recording, tmp_path)
    before = weights.stat().st_mtime_ns
    lines: list[str] = []
    assert run(tiny_recording, tmp_path, progress=lines.append) == weights
    assert weights.stat().st_mtime_ns == before and "is finished" in lines[0]


def test_other_settings_do_not_continue_a_run(tiny_recording: Path, tmp_path: Path) -> None:
    run(tiny_recording, tmp_path)
    with pytest.raises(ValueError, match="holds a run with another training; choose an empty folder"):
        run(tiny_recording, tmp_path, options=replace(OPTIONS, learning_rate=1.0))
    with pytest.raises(ValueError, match="another method, options; choose"):
        run(tiny_recording, tmp_path, method="direct", method_options=METHODS["direct"][0]())


def test_fine_tuning_starts_from_the_given_weights(tiny_recording: Path, tmp_path: Path) -> None:
    first = run(tiny_recording, tmp_path / "first")
    frozen = replace(OPTIONS, steps=1, learning_rate=0.0, ema_decay=0.0, seed=9)
    second = run(tiny_recording, tmp_path / "second", options=frozen, init=first)
    a, b = load_file(first), load_file(second)
    same = [name for name in a if np.array_equal(a[name], b[name])]
    # without a learning rate only the statistics of batch norm move
    assert all("running_" in name or "num_batches" in name for name in set(a) - set(same))
    assert "head.shared_conv.0.weight" in same


def test_what_cannot_start_writes_nothing(tiny_recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(FileNotFoundError, match="no such checkpoint"):
        run(tiny_recording, out, init=tmp_path / "absent.safetensors")
    lidar = next(tiny_recording.rglob("*.bin"))
    for path in tiny_recording.rglob("*.bin"):
        path.write_bytes(b"")
    with pytest.raises(ValueError, match=f"{lidar.suffix}: the LiDAR file has 0 bytes"):
        run(tiny_recording, out)
    assert not out.exists()
