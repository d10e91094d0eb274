"""The demo on recordings of a few pixels: rows, report, and that it repeats."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from test_html import fetched

from checkpoints import write_checkpoint
from coin3d.geometry import Rig
from coin3d.inference import TOWN_ONLY, LoadedDetector, load
from tiny_recording import write_recording

pytest.importorskip("embreex")

from coin3d import cli, demo


def test_demo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    recorded: list[tuple[str, list[int]]] = []

    def record(rig: Rig, out: Path, seeds: Sequence[int], **options: Any) -> Path:
        recorded.append((rig.name, list(seeds)))
        return write_recording(out, scenes=1)

    checkpoints = tuple(str(write_checkpoint(tmp_path / f"{method}.safetensors", method)) for method in ("direct", "coin3d"))
    monkeypatch.setattr(demo, "record", record)
    smaller = partial(demo.DemoOptions, checkpoints=checkpoints, worlds=2, shown=1, min_score=0.0)
    monkeypatch.setattr(demo, "DemoOptions", smaller)
    out = tmp_path / "out"
    assert cli.main(["demo", "--out", str(out)]) == 0
    told = capsys.readouterr().out

    (source, seeds), (target, same_seeds), (rebuilt, one_seed) = recorded
    assert (source, target) == ("nuscenes", "waymo") and seeds == same_seeds == [10_000, 10_001]
    assert rebuilt == source and one_seed == seeds[:1]
    result = json.loads((out / "result.json").read_text())
    assert [(row["method"], row["source"], row["target"]) for row in result["rows"]] == [
        ("direct", "town-nuscenes", "town-nuscenes"),
        ("coin3d", "town-nuscenes", "town-nuscenes"),
        ("direct", "town-nuscenes", "town-waymo"),
        ("coin3d", "town-nuscenes", "town-waymo"),
    ]
    for row in result["rows"]:
        assert {"detector", "mAP", "mATE", "mASE", "mAOE", "NDS*"} < set(row)
        assert f"{row['NDS*']:.3f}" in told
    assert result["protocol"] in told and TOWN_ONLY in told and str(out / "report.html") in told
    report = (out / "report.html").read_text()
    assert fetched(report) == []
    report = html.unescape(report)
    assert result["protocol"] in report and TOWN_ONLY in report
    # cameras and top view of one frame for two methods on two rigs, three of novel views, prior maps, positions
    assert report.count("<img ") == 2 * 2 * 2 + 3 + 2
    assert all(Path(picture).is_file() for picture in result["pictures"])


def _loaded(path: Path, **changed: Any) -> LoadedDetector:
    loaded = load(write_checkpoint(path))
    return replace(loaded, description={**loaded.description, **changed})


def test_detectors_are_told_apart(tmp_path: Path) -> None:
    a, b, c = (
        _loaded(tmp_path / "a" / "model.safetensors", detector="bevdepth", method="coin3d"),
        _loaded(tmp_path / "b" / "model.safetensors", detector="petr", method="coin3d"),
        _loaded(tmp_path / "c" / "model.safetensors", detector="petr", method="none"),
    )
    assert demo._names([a, c]) == ["coin3d", "none"]
    assert demo._names([a, b, c]) == ["bevdepth coin3d", "petr coin3d", "petr none"]
    d = replace(a, path=tmp_path / "d" / "model.safetensors")
    assert demo._names([a, d]) == ["bevdepth coin3d a", "bevdepth coin3d d"]
    with pytest.raises(ValueError, match="two of these are alike"):
        demo._names([a, a])


def test_the_demo_needs_detectors_of_cars(tmp_path: Path) -> None:
    walkers = _loaded(tmp_path / "model.safetensors")
    walkers.model.classes = ("pedestrian",)
    with pytest.raises(ValueError, match="scores cars, this checkpoint knows pedestrian"):
        demo._names([walkers])
