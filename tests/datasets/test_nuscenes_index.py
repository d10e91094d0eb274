"""The index of nuScenes-format tables: made once, made anew when it must be, and always the same frames."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import tracemalloc
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_content import content

from coin3d.datasets import nuscenes_index, nuscenes_join, table_progress
from coin3d.datasets.nuscenes_format import NuScenesRecording
from coin3d.datasets.nuscenes_tables import TABLES
from coin3d.datasets.record_file import RecordFile
from tiny_recording import edit_table

Rows = list[dict[str, Any]]


@pytest.fixture
def root(tiny_recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small recording that is treated as a large one."""
    monkeypatch.setenv("COIN3D_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(nuscenes_index, "SMALL_BYTES", 0)
    return tiny_recording


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The folders whose tables were joined."""
    folders: list[Path] = []

    def counted(folder: Path, *args: Any) -> dict[str, Any]:
        folders.append(folder)
        return nuscenes_join.write_joined(folder, *args)

    monkeypatch.setattr(nuscenes_index, "write_joined", counted)
    return folders


def index_of(root: Path) -> Path:
    return root / "v1.0-tiny" / "tables.index.records"


def test_made_once_and_the_same_as_without_a_file(root: Path, made: list[Path], monkeypatch: pytest.MonkeyPatch) -> None:
    before = sorted(root.rglob("*"))
    contents = {content(NuScenesRecording(root)) for _ in range(3)}
    assert len(made) == 1 and len(contents) == 1
    assert sorted(root.rglob("*")) == sorted([*before, index_of(root)])  # nothing half-written
    index_of(root).unlink()
    monkeypatch.setattr(nuscenes_index, "SMALL_BYTES", 10**6)
    contents.add(content(NuScenesRecording(root)))
    assert len(made) == 2 and len(contents) == 1
    assert sorted(root.rglob("*")) == before, "small recordings keep it in memory"


@pytest.mark.parametrize("table", TABLES)
def test_any_table_outdates_it(root: Path, made: list[Path], table: str) -> None:
    NuScenesRecording(root)
    os.utime(root / "v1.0-tiny" / f"{table}.json", ns=(1, 1))
    NuScenesRecording(root)
    edit_table(root, table, lambda rows: rows[-1].update(unknown=0))
    for _ in range(2):
        NuScenesRecording(root)
    assert len(made) == 3


def test_a_change_shows(root: Path) -> None:
    assert NuScenesRecording(root)[0].scene == "street-0"
    edit_table(root, "scene", lambda rows: rows[0].update(name="street-9"))
    assert NuScenesRecording(root)[0].scene == "street-9"


def test_where_the_folder_cannot_be_written(
    root: Path, tmp_path: Path, made: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    index_of(root).mkdir()  # in the way of the index, for every user
    for _ in range(2):
        assert len(NuScenesRecording(root)) == 6
    (kept,) = (tmp_path / "cache").iterdir()
    assert kept.name.startswith("tables.") and kept.name.endswith(".index.records")
    assert not list(root.rglob("*.part"))
    assert len(made) == 1
    monkeypatch.setenv("COIN3D_CACHE", str(root / "town.json" / "cache"))
    (root / "town.json").write_text("")
    for _ in range(2):
        assert len(NuScenesRecording(root)) == 6
    assert len(made) == 3, "without any place it works all the same"


def test_bad_tables_leave_nothing(root: Path) -> None:
    before = sorted(root.rglob("*"))
    edit_table(root, "sample_annotation", lambda rows: rows[-1].update(sample_token="lost"))
    with pytest.raises(ValueError, match="is 'lost', which is not in"):
        NuScenesRecording(root)
    assert sorted(root.rglob("*")) == before


def test_tables_that_change_meanwhile(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def disturbed(folder: Path, *args: Any) -> dict[str, Any]:
        head = nuscenes_join.write_joined(folder, *args)
        os.utime(folder / "scene.json", ns=(1, 1))
        return head

    monkeypatch.setattr(nuscenes_index, "write_joined", disturbed)
    with pytest.raises(ValueError, match=r"v1\.0-tiny: the tables were changed while they were read"):
        NuScenesRecording(root)
    assert not list(root.rglob("*.part")) and not index_of(root).exists()


@pytest.mark.parametrize("harm", ["flip", "cut", "delete"])
def test_an_index_that_is_harmed_while_it_is_in_use(root: Path, made: list[Path], harm: str) -> None:
    recording = NuScenesRecording(root)
    truth = content(recording)
    data = bytearray(index_of(root).read_bytes())
    if harm == "flip":
        data[int(RecordFile.open(index_of(root)).starts[6]) + 15] ^= 4  # behind the ten bytes that begin a record
    if harm == "delete":
        index_of(root).unlink()
    else:
        index_of(root).write_bytes(data[: len(data) if harm == "flip" else 100])
    assert content(recording) == truth
    assert len(made) == 2
    assert content(NuScenesRecording(root)) == truth and len(made) == 2
    index_of(root).unlink()
    edit_table(root, "scene", lambda rows: rows[0].update(name="street-9"))
    with pytest.raises(
        ValueError, match=r"v1\.0-tiny: the tables were changed while they were in use; open the recording again"
    ):
        recording[0]


def test_other_processes_and_threads(root: Path) -> None:
    recording = NuScenesRecording(root, progress=lambda line: None)  # which cannot be pickled
    truth = content(recording)
    with ThreadPoolExecutor(4) as threads:
        assert set(threads.map(content, [recording] * 8)) == {truth}
    assert content(pickle.loads(pickle.dumps(recording))) == truth
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("fork")) as pool:
        assert pool.submit(content, recording).result(timeout=60) == truth


def test_many_records_of_sweeps_and_tokens(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    truth = content(NuScenesRecording(root))
    index_of(root).unlink()
    monkeypatch.setattr(nuscenes_join, "_SWEEPS_PER_RECORD", 1)
    monkeypatch.setattr(nuscenes_join, "_TOKENS_PER_BUCKET", 1)
    recording = NuScenesRecording(root)
    assert content(recording) == truth
    assert [recording.frame_by_token(frame.token).token for frame in recording] == [frame.token for frame in recording]
    for token in ("", "nowhere", "\ud800"):
        with pytest.raises(KeyError):
            recording.frame_by_token(token)


def test_sweeps_lie_between_key_frames_whatever_the_order_of_rows(root: Path) -> None:
    edit_table(root, "sample_data", lambda rows: rows.reverse())
    recording = NuScenesRecording(root)
    for frame in recording:
        assert [round((time_ns - frame.timestamp_ns) / 1e6) for time_ns, _ in recording.sweeps(frame)] == [166, 332]
        assert all(f"_{frame.token[-1]}_" in file.path.name for _, file in recording.sweeps(frame))


def test_links_of_sweeps_must_resolve_only_for_sweeps(tiny_recording: Path) -> None:
    edit_table(tiny_recording, "ego_pose", lambda rows: rows.remove(next(r for r in rows if r["token"].endswith("0_0_2.bin"))))
    recording = NuScenesRecording(tiny_recording)
    assert len(list(recording)) == 6 and len(recording.sweeps(recording[1])) == 2
    with pytest.raises(
        ValueError, match=r"sample_data\.json: ego_pose_token of row '.+0_0_2\.bin' is '.+', which is not in ego"
    ):
        recording.sweeps(recording[0])
    edit_table(tiny_recording, "sample_data", lambda rows: rows[-1].update(sample_token="lost"))
    recording = NuScenesRecording(tiny_recording)
    with pytest.raises(ValueError, match=r"sample_data\.json: sample_token of row '.+' is 'lost'"):
        recording.sweeps(recording[1])


def test_a_neighbour_that_makes_no_sense_is_an_error_where_it_counts(tiny_recording: Path) -> None:
    edit_table(tiny_recording, "sample_annotation", lambda rows: rows[2].update(translation=[1, "2", 3]))
    recording = NuScenesRecording(tiny_recording)
    assert rows_named(recording, 2, "ann_car0.1") and rows_named(recording, 0, "ann_car0.1")
    assert len(recording[3].boxes) == 2


def rows_named(recording: NuScenesRecording, index: int, token: str) -> bool:
    with pytest.raises(ValueError, match=rf"sample_annotation\.json: annotations of sample '.+': .*row '{token}'"):
        recording[index]
    return True


@pytest.mark.parametrize("link", ["own", "swapped", "elsewhere"])
def test_prev_and_next_that_run_in_circles(tiny_recording: Path, link: str) -> None:
    def change(rows: Rows) -> None:
        for row in rows:
            names = {"own": (row["token"],) * 2, "swapped": (row["next"], row["prev"]), "elsewhere": ("", "ann_car1.0")}
            row["prev"], row["next"] = names[link]

    edit_table(tiny_recording, "sample_annotation", change)
    for frame in NuScenesRecording(tiny_recording):
        assert frame.boxes is not None and np.isnan(frame.boxes.velocity_mps).all()


def test_annotations_keep_their_visibility(tiny_recording: Path) -> None:
    edit_table(tiny_recording, "sample_annotation", lambda rows: rows[0].update(visibility_token="3"))
    rows = nuscenes_index.TablesIndex(tiny_recording / "v1.0-tiny", print).frame(0)["annotations"]
    assert [row.get("visibility_token") for row in rows] == ["3", None]


def test_what_takes_long_says_so(root: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    NuScenesRecording(root)
    assert capsys.readouterr() == ("", "")
    index_of(root).unlink()
    monkeypatch.setattr(table_progress, "_SILENT_S", 0)
    monkeypatch.setattr(table_progress, "_BETWEEN_S", 0)
    lines: list[str] = []
    NuScenesRecording(root, progress=lines.append)
    assert [line.split(": ")[2].split(", ")[0] for line in lines] != [] and "sample_data.json, " in " ".join(lines)
    shares = [int(line.split("%")[0].split()[-1]) for line in lines]
    assert shares == sorted(shares) and shares[-1] <= 100
    NuScenesRecording(root, progress=lines.append)
    assert len(lines) == len(shares), "opening says nothing"


def test_memory_does_not_grow_with_the_tables(root: Path) -> None:
    def longer(rows: Rows) -> None:
        common = {**rows[0], "is_key_frame": False, "padding": "x" * 4000}
        rows += [{**common, "token": f"more{i}"} for i in range(2500)]

    edit_table(root, "sample_data", longer)
    assert (root / "v1.0-tiny" / "sample_data.json").stat().st_size > 10_000_000
    tracemalloc.start()
    try:
        NuScenesRecording(root)
        assert tracemalloc.get_traced_memory()[1] < 8_000_000
    finally:
        tracemalloc.stop()
