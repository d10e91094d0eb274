"""The rig files shown in docs/your_rig.md load as they are."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

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


def test_there_are_examples() -> None:
    assert len(_EXAMPLES) == 5
