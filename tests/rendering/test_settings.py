"""The four settings of the paper, the sheet of pictures, and the verb that writes them."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from coin3d.cli import main
from coin3d.geometry import preset_rig, save_rig
from coin3d.geometry.rig_changes import raised
from coin3d.rendering import Gaussians, prepare, save_gaussians
from coin3d.rendering.gaussian_folder import RIG_FILE, find_frame, recorded_rig
from coin3d.rendering.settings import paper_settings, render_rig, settings_sheet

RIG = preset_rig("nuscenes", 96)


def floor(spacing_m: float = 0.1, reach_m: float = 12.0) -> Gaussians:
    """The ground around the ego, orange, as opaque discs larger than their spacing."""
    x, y = (a.ravel() for a in np.meshgrid(*[np.arange(-reach_m, reach_m, spacing_m)] * 2))
    centre = np.column_stack([x, y, np.zeros_like(x)]).astype(np.float32)
    return Gaussians(centre, np.full(len(x), spacing_m, np.float32), np.tile(np.uint8([250, 120, 20]), (len(x), 1)))


def test_what_is_empty_below_the_horizon_is_counted_there_only() -> None:
    assert render_rig(prepare(Gaussians.empty()), RIG).empty_below_horizon == 1.0
    near = render_rig(prepare(floor()), RIG)
    wide = render_rig(prepare(floor(0.4, 80.0)), RIG)
    assert wide.empty_below_horizon < 0.05 < near.empty_below_horizon < 1
    assert (near.renderings["CAM_FRONT"].alpha[:20] < 0.5).all()  # the sky is empty, which no figure holds against it


def test_settings() -> None:
    settings = paper_settings(RIG)
    assert [len(rig) for rig in settings.values()] == [6, 6, 6, 6]
    assert settings["raw"] is RIG
    low = raised(RIG, -1.0)
    assert list(paper_settings(low)) == ["raw", "full overlap 120 / 60 deg", "height +1 m"]  # none lower: it is in the road


def test_the_sheet_has_a_row_per_setting_and_a_column_per_camera() -> None:
    gaussians = prepare(floor())
    one = {"raw": render_rig(gaussians, RIG)}
    both = {**one, "other": render_rig(gaussians, preset_rig("waymo", 96))}
    assert settings_sheet(both).shape[1] == settings_sheet(one).shape[1]
    assert settings_sheet(both).shape[0] > 1.8 * settings_sheet(one).shape[0]


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """A built scene of two frames, and something in its folder that is no frame."""
    folder = tmp_path / "town-0000"
    (folder / "quality").mkdir(parents=True)
    for token in ("a", "b"):
        save_gaussians(folder / f"{token}.safetensors", floor())
        (folder / "quality" / f"{token}.json").write_text("{}")
    save_gaussians(folder / "objects.safetensors", floor())
    return folder


def test_frames_of_a_scene(scene: Path) -> None:
    assert find_frame(scene).name == "b.safetensors"
    assert find_frame(scene / "a.safetensors").name == "a.safetensors"
    with pytest.raises(FileNotFoundError, match="no built frames"):
        find_frame(scene / "quality")
    with pytest.raises(FileNotFoundError, match="--rig"):
        recorded_rig(find_frame(scene))
    save_rig(RIG, scene / RIG_FILE)
    assert list(recorded_rig(find_frame(scene))) == list(RIG)


def test_the_verb_writes_a_sheet_and_every_image(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "views"
    assert main(["render", str(scene), "--out", str(out)]) == 2
    assert "--rig" in capsys.readouterr().err
    assert main(["render", str(scene), "--rig", "waymo", "--width", "64", "--rerun", "--out", str(out)]) == 0
    result = json.loads((out / "result.json").read_text())
    assert len(result["empty_below_horizon"]) == 4 and len(result["pictures"]) == 1 + 5 + 6 + 5 + 5
    for picture in result["pictures"]:
        assert cv2.imread(picture) is not None
    assert (out / "views.rrd").stat().st_size > 1_000 and not list(out.rglob("*.part"))
    front = cv2.imread(str(out / "raw" / "FRONT.png"))
    assert front.shape[1] == 64
    assert (front[-1] == (20, 120, 250)).all(1).mean() > 0.9  # the floor, through a camera that was never there
