"""Protocols and splits on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from checkpoints import write_checkpoint
from coin3d import cli
from coin3d.commands.protocols import open_target
from coin3d.commands.sources import Sources, choose_sources
from coin3d.datasets.classes import MERGED_CAR, PLAIN_CAR
from coin3d.datasets.open import open_recording
from coin3d.datasets.thinned import Thinned
from coin3d.evaluation.paper_protocols import paper_protocol
from coin3d.geometry import preset_rig
from coin3d.rendering import Gaussians, save_gaussians
from tiny_recording import edit_table, write_recording


@pytest.fixture
def as_nuscenes(tiny_recording: Path) -> Path:
    """Two scenes, the first of nuScenes' val, the second of its train split."""
    names = ["scene-0103", "scene-0061"]
    edit_table(tiny_recording, "scene", lambda rows: [row.update(name=name) for row, name in zip(rows, names, strict=True)])
    return tiny_recording


def test_protocols_are_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["protocols"]) == 0
    everything = capsys.readouterr().out
    assert everything.count("train on") >= 13 and "every 4th frame" in everything
    assert cli.main(["protocols", "nuscenes-to-lyft", "--out", str(tmp_path)]) == 0
    told = capsys.readouterr().out
    assert "plain car" in told and "waymo" not in told
    (row,) = json.loads((tmp_path / "result.json").read_text())["protocols"]
    assert (row["training_classes"], row["scoring_classes"]) == ("merged car", "plain car")
    assert cli.main(["protocols", "n2w"]) == 2
    assert "no protocol 'n2w', there are nuscenes-to-waymo" in capsys.readouterr().err


def test_the_target_of_a_protocol(as_nuscenes: Path, tmp_path: Path) -> None:
    to_nuscenes = paper_protocol("waymo-to-nuscenes")
    assert {f.scene for f in open_target(to_nuscenes, as_nuscenes, ("car",))} == {"scene-0103"}
    with pytest.raises(ValueError, match="scores on lyft, but these scenes are of nuscenes"):
        open_target(paper_protocol("nuscenes-to-lyft"), as_nuscenes, ("car",))
    with pytest.raises(ValueError, match="scores pedestrian, two-wheel, but this checkpoint only knows car"):
        open_target(paper_protocol("mix-to-nuscenes"), as_nuscenes, ("car",))
    elsewhere = write_recording(tmp_path / "other", samples=5)
    with pytest.raises(ValueError, match="scores on nuscenes, but these scenes are not known to be of it"):
        open_target(to_nuscenes, elsewhere, ("car",))
    # Waymo's names are in no list
    waymo = open_target(paper_protocol("nuscenes-to-waymo"), elsewhere, ("car", "pedestrian"))
    assert isinstance(waymo, Thinned) and len(waymo) == 10 and waymo[4].previous == "sample0.0"


def test_the_sources_of_a_protocol(as_nuscenes: Path, tmp_path: Path) -> None:
    mix = choose_sources("mix-to-lyft", None, 1, "merged-car")
    assert {f.scene for f in mix.open(as_nuscenes)} == {"scene-0061"} and "two-wheel" in mix.class_map.classes
    elsewhere = write_recording(tmp_path / "other", samples=5)
    assert [f.token for f in mix.open(elsewhere)] == ["sample0.0", "sample0.4", "sample1.0", "sample1.4"]
    assert mix.selection is not None and mix.selection["protocol"] == "mix-to-lyft"
    with pytest.raises(ValueError, match="trains on lyft; these scenes are of nuscenes"):
        choose_sources("lyft-to-nuscenes", None, 1, "merged-car").open(as_nuscenes)
    assert choose_sources("lyft-to-nuscenes", None, 1, "merged-car").class_map == PLAIN_CAR
    with pytest.raises(ValueError, match="leave --classes, --split and --every out"):
        choose_sources("lyft-to-nuscenes", "train", 1, "merged-car")


def test_sources_by_flags(as_nuscenes: Path) -> None:
    plain = choose_sources(None, None, 1, "merged-car")
    assert plain == Sources(MERGED_CAR) and plain.selection is None and len(plain.open(as_nuscenes)) == 6
    chosen = choose_sources(None, "train", 2, "plain-car")
    assert [f.token for f in chosen.open(as_nuscenes)] == ["sample1.0", "sample1.2"]
    assert chosen.selection == {"split": "train", "every": 2}
    with pytest.raises(ValueError, match="--every is 1"):
        choose_sources(None, None, 0, "merged-car")


def test_evaluate_under_a_protocol_and_check_of_a_split(
    as_nuscenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    weights = str(write_checkpoint(tmp_path / "model.safetensors"))
    words = ["evaluate", weights, str(as_nuscenes), "--pictures", "1", "--protocol", "waymo-to-nuscenes"]
    assert cli.main([*words, "--out", str(tmp_path / "score")]) == 0
    assert "3 frames of 1 of the 150 scenes of nuscenes val" in capsys.readouterr().out
    result = json.loads((tmp_path / "score/result.json").read_text())
    assert result["comparison"]["name"] == "waymo-to-nuscenes" and result["rows"][0]["samples"] == 3
    assert result["protocol"].startswith("waymo-to-nuscenes: car 50 m")
    assert cli.main([*words, "--split", "train", "--out", str(tmp_path / "no")]) == 2
    assert "leave --classes, --split, --range-shape out" in capsys.readouterr().err
    assert cli.main(["check", str(as_nuscenes), "--split", "train", "--frames", "1", "--out", str(tmp_path / "check")]) == 0
    assert json.loads((tmp_path / "check/result.json").read_text())["frames"] == 3


def test_a_recording_seen_through_another_rig(as_nuscenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for frame in open_recording(as_nuscenes, "val"):
        if frame.next:  # the last frame was not built
            (tmp_path / "built" / frame.scene).mkdir(parents=True, exist_ok=True)
            save_gaussians(tmp_path / "built" / frame.scene / f"{frame.token}.safetensors", red_wall())
    out = tmp_path / "copy"
    words = ["re-render", str(as_nuscenes), str(tmp_path / "built"), "--rig", "waymo", "--split", "val", "--width", "64"]
    assert cli.main([*words, "--out", str(out)]) == 0
    assert "2 of 3 frames rendered through rig 'waymo'" in capsys.readouterr().out
    source, copy = open_recording(as_nuscenes, "val"), open_recording(out, "val")
    assert [f.token for f in copy] == ["sample0.0", "sample0.1"] and list(copy[0].rig) == list(preset_rig("waymo"))
    for before, after in zip(source, copy, strict=False):
        np.testing.assert_allclose(after.boxes.centre_m, before.boxes.centre_m, atol=1e-9)
        assert len(after.lidar.load().points_ego) == len(before.lidar.load().points_ego)
        assert after.image("FRONT").shape == (43, 64, 3) and after.image("SIDE_LEFT").shape == (30, 64, 3)
        assert after.image("FRONT")[21, 32].tolist()[1:] == [0, 0] and after.image("FRONT")[21, 32, 0] > 200
        assert not after.image("SIDE_LEFT").any(), "the wall stands ahead"
    capsys.readouterr()
    assert cli.main([*words, "--out", str(out)]) == 2
    assert "is not an empty folder; choose another" in capsys.readouterr().err


def red_wall() -> Gaussians:
    """Opaque red dots 10 m ahead, 4 m wide and 4 m high."""
    y, z = np.meshgrid(np.linspace(-2, 2, 21), np.linspace(0, 4, 21))
    centres = np.stack([np.full_like(y, 10.0), y, z], axis=-1).reshape(-1, 3)
    red = np.tile(np.array([255, 0, 0], dtype=np.uint8), (len(centres), 1))
    return Gaussians(centres.astype(np.float32), np.full(len(centres), 0.3, np.float32), red)
