"""The rig files and the lines of frames.jsonl shown in docs/your_rig.md load as they are."""

from __future__ import annotations

import json
import re
import textwrap
from pathlib import Path

import pytest
import yaml

from coin3d.datasets.own_recording import OwnRecording
from coin3d.geometry.rig_file import rig_from_dict

_DOCS = Path(__file__).resolve().parents[2] / "docs" / "your_rig.md"
_EXAMPLES = re.findall(r"```yaml\n(.*?)```", _DOCS.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize("text", _EXAMPLES)
def test_example_loads(text: str) -> None:
    data = yaml.safe_load(text)
    camera = {"size": [8, 4], "focal": 5, "position": [0, 0, 1.5], "yaw_deg": 0}
    rig = rig_from_dict({"cameras": {"front": camera}, **data})
    for name, entry in rig.items():
        assert entry.ego_from_cam.rotation[2, 1] < -0.95, f"{name} does not stand upright"


_RIG = """
cameras:
  front: {size: [8, 4], focal: 5, position: [1.5, 0, 1.5], yaw_deg: 0}
  rear: {size: [8, 4], focal: 5, position: [0, 0, 1.5], yaw_deg: 180}
"""
_LINES = re.findall(r"\n((?:    [ {}].*\n)+)", _DOCS.read_text(encoding="utf-8"))
_LINES = [textwrap.dedent(text) for text in _LINES if text.startswith("    {")]


def test_the_lines_of_a_recording_load(tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text(_RIG)
    short, long = (json.loads(text) for text in _LINES)
    (tmp_path / "frames.jsonl").write_text(f"{json.dumps({**short, 'token': '0'})}\n{json.dumps(long)}\n")
    plain, full = OwnRecording(tmp_path)
    assert list(plain.rig) == list(full.rig) == ["front", "rear"] and plain.boxes is None and plain.lidar is None
    assert full.scene == "drive-3" and full.lidar is not None and full.boxes is not None
    assert full.boxes.centre_m.round(6).tolist() == [[12.0, -3.0, 0.8]]
    # the rear camera fired 0.3 m earlier
    assert full.rig["rear"].ego_from_cam.translation.round(6).tolist() == [-0.3, 0, 1.5]


def test_there_are_examples() -> None:
    assert len(_EXAMPLES) == 5 and len(_LINES) == 2
