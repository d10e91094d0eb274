"""What is written for Rerun can be read back by Rerun."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from coin3d.geometry import Boxes3D
from coin3d.rendering import Gaussians
from coin3d.report.rerun_file import RerunFile
from small_world import ring_rig

chunk = pytest.importorskip("rerun.chunk", reason="rerun is not installed: pip install 'coin3d[rerun]'")


def read(path: Path) -> dict[str, dict[str, list[Any]]]:
    """Entity -> column -> values, in the order of time."""
    found: dict[str, dict[str, list[Any]]] = {}
    for part in chunk.RrdReader(path).stream():
        columns = found.setdefault(part.entity_path, {})
        table = part.to_record_batch()
        for name in set(table.schema.names) - {"log_time"}:
            columns.setdefault(name, []).extend(table.column(name).to_pylist())
    return found


def test_frames_are_on_a_time_line(tmp_path: Path) -> None:
    rig = ring_rig(2)
    images = {name: np.full((camera.height_px, camera.width_px, 3), 90, dtype=np.uint8) for name, camera in rig.items()}
    cloud = Gaussians(np.ones((5, 3), np.float32), np.full(5, 0.1, np.float32), np.zeros((5, 3), np.uint8))
    boxes = Boxes3D.create([10, 2, 1], [4, 2, 1.5], [np.pi / 2], ["car"])
    path = tmp_path / "deep" / "frames.rrd"
    with RerunFile(path) as file:
        file.log(rig, images, cloud, predictions=boxes, truth=boxes)
        file.log(rig, images, predictions=Boxes3D.empty())
    assert [p.name for p in path.parent.iterdir()] == ["frames.rrd"]
    found = read(path)
    assert found["/ego/predictions"]["frame"] == [0, 1]
    assert np.stack(found["/ego/predictions"]["Boxes3D:centers"][0]).tolist() == [[10, 2, 1]]
    assert found["/ego/predictions"]["Boxes3D:centers"][1] == []
    assert np.stack(found["/ego/truth"]["Boxes3D:half_sizes"][0]).tolist() == [[2, 1, 0.75]]
    quaternion = np.stack(found["/ego/truth"]["Boxes3D:quaternions"][0])
    np.testing.assert_allclose(quaternion, [[0, 0, np.sqrt(0.5), np.sqrt(0.5)]], atol=1e-6)
    clouds = found["/ego/cloud"]["Points3D:positions"]
    assert [len(cloud) for cloud in clouds] == [5, 0], "the cloud of one frame does not stay for the next"
    name = next(iter(rig))
    assert sorted(found[f"/ego/{name}"]["frame"]) == [0, 0, 0, 1, 1, 1], "pose, lens and image of each frame"


def test_nothing_is_left_of_a_file_that_failed(tmp_path: Path) -> None:
    with pytest.raises(KeyError), RerunFile(tmp_path / "frames.rrd") as file:
        file.log(ring_rig(1), {"no such camera": np.zeros((2, 2, 3), np.uint8)})
    assert list(tmp_path.iterdir()) == []


def test_without_the_library_the_message_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ImportError, match=r"pip install 'coin3d\[rerun\]'"):
        RerunFile(tmp_path / "frames.rrd")
