"""Dataclasses as plain data, and files that are written whole or not at all."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from coin3d.augmentation import ArrayChange, BevAugmentation, FocalAugmentation, ImageAugmentation, NovelViewOptions, RigSampler
from coin3d.detectors import BEVDepthConfig
from coin3d.methods import METHODS, CoIn3DOptions
from coin3d.priors import PriorOptions, PriorSet
from coin3d.records import from_plain, to_plain, write_bytes, write_json
from coin3d.training.options import TrainOptions
from coin3d.training.samples import AugmentOptions


@dataclass(frozen=True)
class Inner:
    gain: float = 1.0
    name: str = "x"


@dataclass(frozen=True)
class Outer:
    count: int
    inner: Inner = field(default_factory=Inner)
    sizes: tuple[int, ...] = (1, 2)
    pair: tuple[str, float] = ("a", 0.5)
    maybe: Inner | None = None
    limit: float | None = None
    kind: Literal["red", "blue"] = "red"
    on: bool = True


@given(st.integers(), st.floats(allow_nan=False), st.text(), st.lists(st.integers()), st.booleans(), st.floats(allow_nan=False))
def test_round_trip_through_json(count: int, gain: float, name: str, sizes: list[int], on: bool, limit: float) -> None:
    value = Outer(count, Inner(gain, name), tuple(sizes), (name, gain), Inner() if on else None, limit, "blue", on)
    assert from_plain(Outer, json.loads(json.dumps(to_plain(value)))) == value


@pytest.mark.parametrize(
    "value",
    [
        BEVDepthConfig.paper(),
        BEVDepthConfig.small(),
        BEVDepthConfig.tiny(),
        TrainOptions.paper(),
        TrainOptions.tiny(),
        TrainOptions(augment=AugmentOptions(ImageAugmentation(0.1), BevAugmentation(90), 3)),
        *(kind() for kind, _ in METHODS.values()),
        CoIn3DOptions(
            "paper", PriorSet(pluecker=False), "conv1", False, False, FocalAugmentation(0.9, 1.1), PriorOptions(444.0)
        ),
        CoIn3DOptions(novel_views=NovelViewOptions(0.3, RigSampler(height_m=(1.0, 2.0), array=ArrayChange()))),
    ],
    ids=lambda value: type(value).__name__,
)
def test_every_configuration_survives_json(value: Any) -> None:
    assert from_plain(type(value), json.loads(json.dumps(to_plain(value)))) == value


def test_missing_fields_take_their_defaults() -> None:
    assert from_plain(Outer, {"count": 3, "inner": {"gain": 2}}) == Outer(3, Inner(2.0))
    assert isinstance(from_plain(Outer, {"count": 3, "limit": 2}).limit, float)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"count": 1, "colour": 3}, "Outer has no field colour; it has count, inner"),
        ({"count": 1, "inner": {"gian": 3}}, "Outer.inner has no field gian"),
        ({"count": 1, "inner": 7}, "Outer.inner must be a set of fields, got 7"),
        ({"count": "1"}, "Outer.count is of kind int, got '1'"),
        ({"count": True}, "Outer.count is of kind int, got True"),
        ({"count": 1, "inner": {"gain": "loud"}}, "Outer.inner.gain is of kind float"),
        ({"count": 1, "inner": {"gain": False}}, "Outer.inner.gain is of kind float"),
        ({"count": 1, "on": 1}, "Outer.on is of kind bool"),
        ({"count": 1, "kind": "green"}, "Outer.kind is one of 'red', 'blue', got 'green'"),
        ({"count": 1, "sizes": [1, "2"]}, r"Outer.sizes\[1\] is of kind int"),
        ({"count": 1, "sizes": 5}, "Outer.sizes is a list, got 5"),
        ({"count": 1, "pair": ["a"]}, "Outer.pair holds 2 values, got 1"),
        ({"count": 1, "maybe": {"size": 1}}, "Outer.maybe has no field size"),
        ([1, 2], "Outer must be a set of fields"),
    ],
)
def test_data_that_does_not_fit_is_named(data: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        from_plain(Outer, data)


def test_plain_data_by_hand() -> None:
    value = {"path": Path("a/b"), 3: (1, [Inner(2.0)]), "none": None}
    assert to_plain(value) == {"path": "a/b", "3": [1, [{"gain": 2.0, "name": "x"}]], "none": None}


def test_files_are_replaced_whole(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "er" / "file"
    write_bytes(path, b"first")
    write_bytes(path, b"second")
    assert path.read_bytes() == b"second"
    write_json(path, Inner(3.0))
    assert json.loads(path.read_text()) == {"gain": 3.0, "name": "x"}
    assert [p.name for p in path.parent.iterdir()] == ["file"]


def full_disk(path: Path, content: bytes) -> int:
    with path.open("wb") as file:
        file.write(content[: len(content) // 2])
    raise OSError(28, "No space left on device")


def interrupted(path: Path, content: bytes) -> int:
    with path.open("wb") as file:
        file.write(content[:1])
    raise KeyboardInterrupt


def test_a_full_disk_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "model"
    write_bytes(path, b"old")
    monkeypatch.setattr(Path, "write_bytes", full_disk)
    with pytest.raises(OSError, match=r"model: cannot be written \(No space left on device\); nothing was changed"):
        write_bytes(path, b"new content")
    assert [p.name for p in tmp_path.iterdir()] == ["model"]
    assert path.read_bytes() == b"old"


def test_an_interruption_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "model"
    write_bytes(path, b"old")
    monkeypatch.setattr(Path, "write_bytes", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_bytes(path, b"new content")
    assert [p.name for p in tmp_path.iterdir()] == ["model"] and path.read_bytes() == b"old"


def test_a_folder_that_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(OSError, match="cannot be written"):
        write_bytes(tmp_path / "taken" / "model", b"content")
    assert (tmp_path / "taken").read_text() == "a file"
