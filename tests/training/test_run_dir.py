"""What a run says about the data it was made from."""

from __future__ import annotations

from pathlib import Path

from coin3d.datasets.index_place import FRAMES_SUFFIX, TABLES_SUFFIX
from coin3d.training.run_dir import fingerprint


def test_the_fingerprint_is_that_of_the_data_and_not_of_indexes_beside_it(tmp_path: Path) -> None:
    (tmp_path / "scene.json").write_text("[]")
    before = fingerprint([tmp_path])
    for suffix in (FRAMES_SUFFIX, TABLES_SUFFIX):
        (tmp_path / f"tables{suffix}").write_text("made by a reader")
    assert fingerprint([tmp_path]) == before
    (tmp_path / "scene.json").write_text("{}")
    assert fingerprint([tmp_path]) != before
