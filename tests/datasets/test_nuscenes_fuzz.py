"""Damaged nuScenes-format tables and indexes: a clear error or frames, within bounded time and memory."""

from __future__ import annotations

import json
import shutil
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from recording_content import content

from coin3d.datasets import nuscenes_index, nuscenes_join
from coin3d.datasets.nuscenes_format import NuScenesRecording
from coin3d.datasets.nuscenes_tables import TABLES
from tiny_recording import edit_table, write_recording

FEW = settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
MAX_BYTES = 20_000_000

Flips = st.lists(st.tuples(st.integers(0, 2**31), st.integers(0, 7)), min_size=1, max_size=4)
FIELDS = [
    *(("scene", name) for name in ("token", "name")),
    *(("sample", name) for name in ("token", "timestamp", "scene_token")),
    *(("sample_data", name) for name in ("token", "sample_token", "ego_pose_token", "calibrated_sensor_token", "filename")),
    *(("sample_data", name) for name in ("timestamp", "is_key_frame", "width", "height")),
    *(("ego_pose", name) for name in ("token", "translation", "rotation")),
    *(("calibrated_sensor", name) for name in ("token", "sensor_token", "translation", "rotation", "camera_intrinsic")),
    *(("sensor", name) for name in ("token", "channel", "modality")),
    *(("sample_annotation", name) for name in ("token", "sample_token", "instance_token", "translation", "size", "rotation")),
    *(("sample_annotation", name) for name in ("num_lidar_pts", "prev", "next", "visibility_token")),
    *(("instance", name) for name in ("token", "category_token")),
    *(("category", name) for name in ("token", "name")),
]
# what never is right, whatever the field; 1e400 is read as infinity
NONSENSE = [
    *("null", "[]", "{}", "NaN", "Infinity", "-Infinity", "1e400", "-1", "0.5", "1e308", "9" * 400, "[[]]", '[{"a": 1}]', '""'),
    *("[" * 60 + "]" * 60, "[1, 2]", '["1", "2", "3"]', "[1, 2, NaN]", "[1e308, -1e308, 1e308]", "[true, false, true]"),
    *(
        '"../../etc/passwd"',
        '"/etc/passwd"',
        '"a\\u0000b"',
        '"\\ud800"',
        '"."',
        '"C:\\\\x"',
        json.dumps("x" * 300),
        json.dumps("x" * 20_000),
    ),
    *("[" + "9" * 400 + ", 1, 2]", "[[1, 2, 3], [4, 5, 6], [7, 8, 9]]", "[[1, 0, 0], [0, 1], [0, 0, 1]]"),
]


@pytest.fixture(scope="module")
def truth(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(tmp_path_factory.mktemp("truth") / "tiny", samples=2, files=False)


@pytest.fixture(scope="module")
def tables(truth: Path) -> dict[str, bytes]:
    return {table: (truth / "v1.0-tiny" / f"{table}.json").read_bytes() for table in TABLES}


@pytest.fixture
def folder(tmp_path: Path, truth: Path) -> Path:
    shutil.copytree(truth, tmp_path / "tiny")
    return tmp_path / "tiny" / "v1.0-tiny"


def with_table(folder: Path, tables: dict[str, bytes], changed: str, data: bytes) -> Path:
    """The recording with one table changed; earlier changes are undone."""
    for table, whole in tables.items():
        (folder / f"{table}.json").write_bytes(data if table == changed else whole)
    return folder.parent


def read_all(root: Path) -> str | None:
    """Everything of all frames, or None where an error names a table."""
    try:
        return content(NuScenesRecording(root))
    except ValueError as error:
        assert ".json" in str(error) and "v1.0-tiny" in str(error)
        assert len(str(error)) < 5000
        return None


@FEW
@given(table=st.sampled_from(TABLES), cut=st.floats(0, 1, exclude_max=True))
def test_cut_anywhere(folder: Path, tables: dict[str, bytes], table: str, cut: float) -> None:
    whole = tables[table]
    root = with_table(folder, tables, table, whole[: int(cut * len(whole))])
    with pytest.raises(ValueError, match=rf"{table}\.json: not a JSON list"):
        NuScenesRecording(root)


@FEW
@given(table=st.sampled_from(TABLES), flips=Flips)
def test_flipped_bits(folder: Path, tables: dict[str, bytes], table: str, flips: list[tuple[int, int]]) -> None:
    data = bytearray(tables[table])
    for place, bit in flips:
        data[place % len(data)] ^= 1 << bit
    read_all(with_table(folder, tables, table, bytes(data)))


@settings(FEW, max_examples=50)
@given(field=st.sampled_from(FIELDS), nonsense=st.sampled_from(NONSENSE), row=st.integers(0, 100))
def test_wrong_kinds_of_values(folder: Path, tables: dict[str, bytes], field: tuple[str, str], nonsense: str, row: int) -> None:
    table, name = field
    rows = json.loads(tables[table])
    rows[row % len(rows)][name] = "NONSENSE"
    data = json.dumps(rows).replace('"NONSENSE"', nonsense).encode()
    found = read_all(with_table(folder, tables, table, data))
    if found is not None:  # of what is used, only what no link or rule can tell from the truth
        assert "inf" not in found and "1e+308" not in found


@pytest.mark.parametrize(
    ("table", "name", "nonsense"),
    [
        ("sample", "timestamp", "[]"),
        ("sample", "timestamp", "1e400"),
        ("sample_data", "is_key_frame", '"false"'),
        ("sample_data", "width", '"96"'),
        ("sample_data", "width", "1000000"),
        ("sample_data", "height", "0.5"),
        ("sample_data", "filename", '["a"]'),
        ("ego_pose", "translation", '["1", "2", "3"]'),
        ("ego_pose", "rotation", "[" + "9" * 400 + ", 0, 0, 0]"),
        ("calibrated_sensor", "camera_intrinsic", "[[true, false, true], [true, true, true], [0, 0, 1]]"),
        ("calibrated_sensor", "translation", "[" * 60 + "]" * 60),
        ("sensor", "channel", "7"),
        ("sample_annotation", "num_lidar_pts", "[7]"),
        ("sample_annotation", "num_lidar_pts", "-2"),
        ("sample_annotation", "size", "[1, 2, Infinity]"),
        ("sample_annotation", "size", "null"),
        ("sample_annotation", "size", "[1, 2, 3, 4]"),
        ("sample_annotation", "instance_token", '["car0"]'),
        ("sample_annotation", "prev", "{}"),
        ("category", "name", json.dumps("x" * 300)),
        ("scene", "name", "5"),
        ("instance", "token", "null"),
    ],
)
def test_these_never_pass(folder: Path, tables: dict[str, bytes], table: str, name: str, nonsense: str) -> None:
    rows = json.loads(tables[table])
    rows[0][name] = "NONSENSE"
    root = with_table(folder, tables, table, json.dumps(rows).replace('"NONSENSE"', nonsense).encode())
    with pytest.raises(ValueError, match=rf"{table}\.json"):
        content(NuScenesRecording(root))


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[" * 1_000_000, "recursion|more than"),
        ('[{"token": "' + "x" * 5_000_000, "Unterminated string|more than"),
        ('[{"token": "' + "x" * 5_000_000 + '"}]', "Unterminated string|more than"),
        ('[{"token": "a", "x": ' + "9" * 5000 + "}]", "integer"),
        ('[{"token": "a", "x": [' + "1," * 1_100_000 + "1]}]", "more than 1048576 characters"),
        ('[{"token": "a"}, {}]', "row 1 has no 'token'"),
        ('[{"token": "a"}, 7]', "row 1 has no 'token'"),
        ('[{"token": "a"}] []', "something follows"),
        ('{"token": "a"}', "expected a list"),
        ('[{"token": "a"} {"token": "b"}]', "expected ',' or ']'"),
        ("", "ends where a list is expected"),
        ("\x00", "expected a list"),
    ],
)
def test_texts_that_are_no_table(folder: Path, tables: dict[str, bytes], text: str, why: str) -> None:
    root = with_table(folder, tables, "ego_pose", text.encode())
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match=rf"ego_pose\.json: not a JSON list of rows with a 'token' each \(.*({why})"):
            NuScenesRecording(root)
        assert tracemalloc.get_traced_memory()[1] < MAX_BYTES
    finally:
        tracemalloc.stop()


def test_tokens_of_other_encodings_and_repeats(folder: Path, tables: dict[str, bytes]) -> None:
    with pytest.raises(ValueError, match=r"scene\.json: .*not UTF-8"):
        NuScenesRecording(with_table(folder, tables, "scene", tables["scene"].decode().encode("utf-16")))
    marked = b"\xef\xbb\xbf" + tables["scene"]
    assert read_all(with_table(folder, tables, "scene", marked)) is not None
    rows = json.loads(tables["ego_pose"])
    data = json.dumps([*rows, rows[3], rows[3], rows[5]]).encode()
    with pytest.raises(
        ValueError, match=rf"ego_pose\.json: 3 rows repeat the token of another row, first '{rows[3]['token']}'"
    ):
        NuScenesRecording(with_table(folder, tables, "ego_pose", data))


def test_more_annotations_than_a_frame_can_have(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(nuscenes_join, "_MOST_PER_FRAME", 4)
    assert len(NuScenesRecording(folder.parent)) == 4

    def more(rows: list[dict[str, Any]]) -> None:
        rows += [{**rows[0], "token": f"more{i}"} for i in range(3)]

    edit_table(folder.parent, "sample_annotation", more)
    with pytest.raises(ValueError, match=r"sample_annotation\.json: sample 'sample0\.0' has more than 4 rows"):
        NuScenesRecording(folder.parent)


@FEW
@given(links=st.lists(st.integers(-1, 5), min_size=12, max_size=12))
def test_tracks_linked_at_random(folder: Path, tables: dict[str, bytes], links: list[int]) -> None:
    rows = json.loads(tables["sample_annotation"])
    tokens = [*(row["token"] for row in rows), ""]
    for i, row in enumerate(rows):
        row["prev"], row["next"] = tokens[links[2 * i] % len(tokens)], tokens[links[2 * i + 1] % len(tokens)]
    recording = NuScenesRecording(with_table(folder, tables, "sample_annotation", json.dumps(rows).encode()))
    for frame in recording:
        assert frame.boxes is not None
        speeds = np.linalg.norm(frame.boxes.velocity_mps, axis=1)
        assert (np.isnan(speeds) | (speeds < 60)).all()


@settings(FEW, max_examples=15)
@given(flips=Flips, cut=st.none() | st.floats(0, 1, exclude_max=True))
def test_damaged_indexes_are_made_anew(folder: Path, flips: list[tuple[int, int]], cut: float | None) -> None:
    small, nuscenes_index.SMALL_BYTES = nuscenes_index.SMALL_BYTES, 0
    place = folder / "tables.index.records"
    try:
        place.unlink(missing_ok=True)
        whole = content(NuScenesRecording(folder.parent))
        data = bytearray(place.read_bytes())
        for at, bit in flips:
            data[at % len(data)] ^= 1 << bit
        place.write_bytes(bytes(data) if cut is None else data[: int(cut * len(data))])
        assert content(NuScenesRecording(folder.parent)) == whole
    finally:
        nuscenes_index.SMALL_BYTES = small
