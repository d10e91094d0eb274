"""The index of a file: made once, remade when the file changes, kept elsewhere where the folder cannot be written."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path

import pytest

from coin3d.datasets.frame_index import indexed


@dataclass(frozen=True)
class Entry:
    name: str
    start: int

    def __post_init__(self) -> None:
        if not isinstance(self.start, int):
            raise ValueError("start")


class Builder:
    def __init__(self) -> None:
        self.calls = 0

    def __call__(self) -> list[Entry]:
        self.calls += 1
        return [Entry("a", 1), Entry("b", 2)]


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("COIN3D_CACHE", str(tmp_path / "cache"))
    path = tmp_path / "data" / "a.tfrecord"
    path.parent.mkdir()
    path.write_bytes(b"0123")
    return path


def test_made_once_and_read_after(path: Path, tmp_path: Path) -> None:
    build = Builder()
    for _ in range(3):
        assert indexed(path, Entry, build) == [Entry("a", 1), Entry("b", 2)]
    assert build.calls == 1
    assert sorted(p.name for p in path.parent.iterdir()) == ["a.tfrecord", "a.tfrecord.index.json"]  # nothing half-written
    assert not (tmp_path / "cache").exists()


def test_size_and_time_outdate_it(path: Path) -> None:
    build = Builder()
    indexed(path, Entry, build)
    path.write_bytes(b"01234")
    indexed(path, Entry, build)
    assert build.calls == 2
    os.utime(path, ns=(1, 1))
    indexed(path, Entry, build)
    indexed(path, Entry, build)
    assert build.calls == 3


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text[: len(text) // 2],
        lambda text: "",
        lambda text: "[]",
        lambda text: "[" * 100_000,
        lambda text: text.replace('"start"', "1"),
        lambda text: text.replace('["b",2]', '["b","2"]'),
        lambda text: text.replace('["b",2]', '["b",2,3]'),
        lambda text: text.replace("index 1", "index 0"),
        lambda text: json.dumps({**json.loads(text), "entries": None}),
    ],
)
def test_a_damaged_index_is_made_anew(path: Path, damage: object) -> None:
    build = Builder()
    indexed(path, Entry, build)
    place = path.with_name("a.tfrecord.index.json")
    place.write_text(damage(place.read_text()))
    assert indexed(path, Entry, build) == [Entry("a", 1), Entry("b", 2)]
    assert build.calls == 2 or damage(place.read_text()) == place.read_text()
    assert json.loads(place.read_text())["size"] == 4


def test_where_the_folder_cannot_be_written(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path.with_name("a.tfrecord.index.json").mkdir()  # in the way of the index, for every user
    build = Builder()
    for _ in range(2):
        assert len(indexed(path, Entry, build)) == 2
    assert build.calls == 1
    (kept,) = (tmp_path / "cache").iterdir()
    assert kept.name.startswith("a.tfrecord.") and kept.name.endswith(".index.json")
    # another file of the same name elsewhere has an index of its own
    twin = tmp_path / "other" / "a.tfrecord"
    twin.parent.mkdir()
    twin.write_bytes(path.read_bytes())
    twin.with_name("a.tfrecord.index.json").mkdir()
    indexed(twin, Entry, build)
    assert build.calls == 2 and len(list((tmp_path / "cache").iterdir())) == 2
    # and without any place it works all the same
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("COIN3D_CACHE", str(tmp_path / "file" / "cache"))
    for calls in (3, 4):
        assert len(indexed(twin, Entry, build)) == 2
        assert build.calls == calls


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="nothing"):
        indexed(tmp_path / "nothing", Entry, Builder())
