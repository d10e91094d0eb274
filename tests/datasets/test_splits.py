"""Splits as text files, and recordings opened by split."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from coin3d.datasets.nuscenes_format import NuScenesRecording
from coin3d.datasets.open import open_recording
from coin3d.datasets.splits import chosen_scenes, coverage, data_set_of, known_splits, read_names
from tiny_recording import edit_table, write_recording


def test_the_lists_have_the_published_sizes_and_do_not_overlap() -> None:
    splits = known_splits()
    sizes = {data_set: {name: len(scenes) for name, scenes in named.items()} for data_set, named in splits.items()}
    assert sizes == {
        "nuscenes": {"train": 700, "val": 150, "test": 150, "mini_train": 8, "mini_val": 2},
        "lyft": {"train": 150, "val": 30},
    }
    nuscenes, lyft = splits["nuscenes"], splits["lyft"]
    assert len(nuscenes["train"] | nuscenes["val"] | nuscenes["test"]) == 1000
    assert len(lyft["train"] | lyft["val"]) == 180
    assert nuscenes["mini_train"] | nuscenes["mini_val"] <= nuscenes["train"] | nuscenes["val"]


def test_known_members() -> None:
    nuscenes = known_splits()["nuscenes"]
    assert "scene-0061" in nuscenes["mini_train"] & nuscenes["train"]
    assert nuscenes["mini_val"] == {"scene-0103", "scene-0916"} and nuscenes["mini_val"] <= nuscenes["val"]
    assert "scene-0001" in nuscenes["train"] and "scene-0003" in nuscenes["val"] and "scene-0077" in nuscenes["test"]


def test_names_are_of_the_form_of_their_data_set() -> None:
    assert all(re.fullmatch(r"scene-\d{4}", name) for names in known_splits()["nuscenes"].values() for name in names)
    for name in set().union(*known_splits()["lyft"].values()):
        found = re.fullmatch(r"host-a\d{3}-lidar0-(\d{19})-(\d{19})", name)
        assert found is not None, name
        seconds = (int(found[2]) - int(found[1])) * 1e-9
        assert seconds == pytest.approx(24.9, abs=0.005), "126 frames at 5 Hz"


def _as_nuscenes(root: Path) -> Path:
    names = ["scene-0103", "scene-0061"]
    edit_table(root, "scene", lambda rows: [row.update(name=name) for row, name in zip(rows, names, strict=True)])
    return root


def test_a_recording_by_split_keeps_its_order_and_neighbours(tiny_recording: Path) -> None:
    root = _as_nuscenes(tiny_recording)
    assert {f.scene for f in open_recording(root, "val")} == {"scene-0103"}
    train = open_recording(root, "train")
    assert [(f.token, f.previous, f.next) for f in train] == [
        ("sample1.0", "", "sample1.1"),
        ("sample1.1", "sample1.0", "sample1.2"),
        ("sample1.2", "sample1.1", ""),
    ]
    assert isinstance(train, NuScenesRecording) and train.scene_names() == ["scene-0061"] * 3
    assert len(train.sweeps(train[0])) == 2
    with pytest.raises(KeyError):
        train.frame_by_token("sample0.0")
    assert len(open_recording(root)) == 6


def test_text_files_and_lists_of_names(tiny_recording: Path, tmp_path: Path) -> None:
    path = tmp_path / "night.txt"
    path.write_text("# at night\n\n  street-1 \n")
    assert {f.scene for f in open_recording(tiny_recording, str(path))} == {"street-1"}
    assert {f.scene for f in open_recording(tiny_recording, path)} == {"street-1"}
    assert len(open_recording(tiny_recording, ["street-1", "street-0"])) == 6


@pytest.mark.parametrize(
    ("content", "message"),
    [(b"# nothing\n", "lists no scenes"), (b"a\nb\na\n", "lists scene a more than once"), (b"\xff\xfe", "not a text file")],
)
def test_lists_that_are_refused(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "x.txt").write_bytes(content)
    with pytest.raises(ValueError, match=rf"x\.txt: {message}"):
        read_names(tmp_path / "x.txt")


def test_what_cannot_be_chosen(tiny_recording: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"no split 'val' is known for its scenes \(street-0, street-1\)"):
        open_recording(tiny_recording, "val")
    with pytest.raises(ValueError, match="has no scene street-9; its own are street-0, street-1"):
        open_recording(tiny_recording, ["street-1", "street-9"])
    with pytest.raises(FileNotFoundError, match=r"gone\.txt: no such list"):
        open_recording(tiny_recording, "gone.txt")
    root = _as_nuscenes(tiny_recording)
    with pytest.raises(ValueError, match="nuscenes has no split 'validation', only mini_train, mini_val, test, train, val"):
        open_recording(root, "validation")
    with pytest.raises(ValueError, match=r"none of its 2 scenes \(scene-0103, scene-0061\) is in the split test"):
        open_recording(root, "test")
    (tmp_path / "van").mkdir()
    (tmp_path / "van" / "rig.yaml").write_text("")
    with pytest.raises(ValueError, match=r"no split 'val': name scenes in frames\.jsonl"):
        open_recording(tmp_path / "van", "val")


def test_coverage_says_how_much_of_a_split_is_there() -> None:
    assert coverage("val", ["scene-0003", "scene-0012"]) == "2 of the 150 scenes of nuscenes val"
    assert coverage(None, ["a", "b", "a"]) == "2 scenes"
    assert coverage("night.txt", ["a"]) == "1 scenes of night.txt"
    assert data_set_of(["host-a004-lidar0-1233080749298771736-1233080774198118416"]) == "lyft"
    assert data_set_of(["town-0000"]) is None
    assert chosen_scenes(None, ["b", "a"], "here") == ["b", "a"]


def test_a_test_set_without_annotations_has_no_labels(tmp_path: Path) -> None:
    root = _as_nuscenes(write_recording(tmp_path / "v"))
    for table in ("sample_annotation", "instance"):
        edit_table(root, table, lambda rows: rows.clear())
    assert all(frame.boxes_world is None for frame in open_recording(root, "val"))
