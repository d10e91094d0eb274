"""The command line on small inputs: what each verb leaves behind, and that mistakes end in one line."""

from __future__ import annotations

import json
import subprocess
import sys
import time
import typing
from pathlib import Path

import cv2
import numpy as np
import pytest

from checkpoints import write_checkpoint
from coin3d import cli
from coin3d.commands.outcome import spread
from coin3d.commands.train import CoIn3DFlags
from coin3d.datasets.open import open_recording
from coin3d.detectors import BEVDepthConfig
from coin3d.geometry import Fisheye, load_rig, save_rig
from coin3d.priors import Projector
from coin3d.rendering import Gaussians, save_gaussians
from small_world import CONFIG, ring_rig
from tiny_recording import write_recording

RIG_OF_THE_REAL_FRAME = """\
name: typed from the calibration of scene-0061
cameras:
  CAM_FRONT:       {size: [1600, 900], focal: 1266, centre: [816, 491], position: [1.70, 0.02, 1.51], yaw_deg: 0.2}
  CAM_FRONT_LEFT:  {size: [1600, 900], focal: 1273, centre: [827, 479], position: [1.52, 0.49, 1.51], yaw_deg: 55.2}
  CAM_FRONT_RIGHT: {size: [1600, 900], focal: 1261, centre: [808, 495], position: [1.55, -0.49, 1.50], yaw_deg: -56.4}
  CAM_BACK:        {size: [1600, 900], focal: 809, centre: [829, 482], position: [0.03, 0.00, 1.58], yaw_deg: 179.9}
  CAM_BACK_LEFT:   {size: [1600, 900], focal: 1257, centre: [792, 493], position: [1.04, 0.48, 1.59], yaw_deg: 108.6}
  CAM_BACK_RIGHT:  {size: [1600, 900], focal: 1260, centre: [807, 501], position: [1.01, -0.48, 1.57], yaw_deg: -110.8}
"""


def result(out: Path) -> dict[str, typing.Any]:
    return json.loads((out / "result.json").read_text())


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(write_checkpoint(tmp_path_factory.mktemp("weights") / "model.safetensors"))


@pytest.fixture
def own_images(tmp_path: Path) -> Path:
    """Two frames of two cameras beside a rig.yaml."""
    folder = tmp_path / "van"
    rig = ring_rig(2)
    for name in rig:
        (folder / name).mkdir(parents=True)
        for frame in (1, 2):
            cv2.imwrite(str(folder / name / f"{frame}.png"), np.full((64, 96, 3), 40 * frame, dtype=np.uint8))
    save_rig(rig, folder / "rig.yaml")
    return folder


def test_help_is_quick_and_names_every_verb() -> None:
    source = Path(cli.__file__).parents[1]
    code = f"import sys; sys.path.insert(0, {str(source)!r}); from coin3d.cli import main; main(['--help']); "
    code += "assert 'torch' not in sys.modules and 'cv2' not in sys.modules"
    began = time.monotonic()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert time.monotonic() - began < 10
    for verb in cli.VERBS:
        assert f"\n  {verb} " in done.stdout
    assert "know only the town" in done.stdout


@pytest.mark.parametrize("verb", cli.VERBS)
def test_every_verb_has_help_with_examples(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        cli.main([verb, "--help"])
    told = capsys.readouterr().out
    assert stop.value.code == 0
    assert f"\n  coin3d {verb} " in told and ("OUT.safetensors" if verb == "convert" else "--out PATH") in told


def test_nothing_asked_shows_the_tutorial_and_fails(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([]) == 2
    assert "usage: coin3d VERB" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("detct x", "no verb 'detct'; did you mean detect?"),
        (
            "detect nowhere.safetensors {van} --out {out}",
            "nowhere.safetensors: no such checkpoint; give a file, or a shipped",
        ),
        ("detect {van}/rig.yaml {van} --out {out}", "not a complete safetensors file"),
        ("detect {weights} {out}/gone --out {out}", "gone: no such folder"),
        ("detect {weights} {van} --out {out} --frames -1", "is 0 (all) or more, got -1"),
        ("evaluate {weights} {van} --out {out}", "no annotations to score against; coin3d detect needs none"),
        ("evaluate {weights} {van} --out {out} --classes three-class", "this checkpoint only knows car"),
        ("train --out {out}", "name at least one recording"),
        ("train {van} --out {out} --method direct --placement paper", "direct has no placement"),
        ("train {van} --out {out} --priors", "--priors needs at least one"),
        ("train {van} --out {out} --init {van}/none.safetensors", "no such checkpoint"),
        ("check {van}/eye0 --out {out}", "not a recording"),
        ("rig lyft3 --out {out}", "no rig preset 'lyft3'"),
        ("town --out {out} --rig lyft3", "lyft3"),
    ],
)
def test_mistakes_end_in_one_line(
    arguments: str, message: str, own_images: Path, checkpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    words = arguments.format(van=own_images, out=out, weights=checkpoint).split()
    assert cli.main(words) == 2
    told = capsys.readouterr().err
    assert told.startswith("coin3d: error: ") and told.count("\n") == 1
    assert message in told
    assert not (out / "result.json").exists()


def test_the_traceback_on_request(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    monkeypatch.setenv("COIN3D_DEBUG", "1")
    assert cli.main(["rig", "lyft3", "--out", str(tmp_path)]) == 2
    assert "Traceback" in capsys.readouterr().err


def test_bad_rig_files_are_named(own_images: Path, checkpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = own_images / "rig.yaml"
    path.write_text("cameras:\n  eye0: {size: [96, 64], focal: 60, position: [1, 0], yaw_deg: 0}\n")
    assert cli.main(["detect", checkpoint, str(own_images), "--out", str(tmp_path / "out")]) == 2
    assert "rig.yaml: camera 'eye0': 'position' takes 3 numbers" in capsys.readouterr().err


def test_missing_images_are_named(
    own_images: Path, checkpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (own_images / "eye1" / "2.png").unlink()
    assert cli.main(["detect", checkpoint, str(own_images), "--out", str(tmp_path / "out")]) == 2
    assert "camera 'eye1' lacks the frames 2" in capsys.readouterr().err


def test_detect_on_own_images(own_images: Path, checkpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert cli.main(["detect", checkpoint, str(own_images), "--out", str(out), "--min-score", "0"]) == 0
    told = capsys.readouterr().out
    content = json.loads((out / "detections.json").read_text())
    assert [frame["token"] for frame in content["frames"]] == ["1", "2"]
    boxes = content["frames"][0]["boxes"]
    assert result(out)["boxes"] == sum(len(frame["boxes"]) for frame in content["frames"]) > 0
    assert set(boxes[0]) == {"label", "score", "centre_m", "size_m", "yaw_rad"} and "boxes_vehicle" not in content["frames"][0]
    for picture in result(out)["pictures"]:
        assert picture in told and cv2.imread(picture) is not None
    assert len(result(out)["pictures"]) == 4
    assert not list(out.rglob("*.part"))


def test_detect_on_a_point_cloud(tiny_recording: Path, checkpoint: str, tmp_path: Path) -> None:
    frame = open_recording(tiny_recording)[0]
    floor = np.stack(np.meshgrid(np.arange(0, 30, 0.2), np.arange(-9, 9, 0.2), 0.0), axis=-1).reshape(-1, 3)
    orange = np.tile(np.array([[250, 120, 20]], dtype=np.uint8), (len(floor), 1))
    cloud = Gaussians(floor.astype(np.float32), np.full(len(floor), 0.1, np.float32), orange)
    save_gaussians(tmp_path / "clouds" / frame.scene / f"{frame.token}.safetensors", cloud)
    words = ["detect", checkpoint, str(tiny_recording), "--out", str(tmp_path / "out"), "--rerun", "--min-score", "0.99"]
    assert cli.main([*words, "--gaussians", str(tmp_path / "clouds")]) == 0
    pictures = [Path(p) for p in result(tmp_path / "out")["pictures"]]
    (on_cloud,) = [p for p in pictures if p.name.endswith("_cloud.png")]
    assert (cv2.imread(str(on_cloud)) == (20, 120, 250)).all(-1).mean() > 0.05
    assert (tmp_path / "out" / "frames.rrd").stat().st_size > 10_000
    assert cli.main([*words, "--gaussians", str(tmp_path / "none")]) == 2


def test_detections_in_the_users_own_frame(own_images: Path, checkpoint: str, tmp_path: Path) -> None:
    path = own_images / "rig.yaml"
    rows = "[[1, 0, 0, 2.0], [0, 1, 0, 0], [0, 0, 1, 0.5], [0, 0, 0, 1]]"
    path.write_text(path.read_text() + f"ego_from_vehicle: {rows}\n")
    assert cli.main(["detect", checkpoint, str(own_images), "--out", str(tmp_path), "--frames", "1"]) == 0
    (frame,) = json.loads((tmp_path / "detections.json").read_text())["frames"]
    for box, own in zip(frame["boxes"], frame["boxes_vehicle"], strict=True):
        np.testing.assert_allclose(np.subtract(box["centre_m"], own["centre_m"]), [2.0, 0.0, 0.5], atol=2e-3)


def test_evaluate(tiny_recording: Path, checkpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    words = ["evaluate", checkpoint, str(tiny_recording), "--out", str(out), "--range-shape", "square", "--pictures", "1"]
    assert cli.main(words) == 0
    told = capsys.readouterr().out
    (row,) = result(out)["rows"]
    assert {"mAP", "mATE", "mASE", "mAOE", "NDS*"} < set(row)
    assert (row["detector"], row["method"], row["source"], row["target"]) == ("bevdepth", "coin3d", "town_nuscenes", "tiny")
    assert row["samples"] == 6 and row["truth_boxes"] == 6
    assert "merged car: car 50 m, square" in told and result(out)["protocol"] in told
    assert len(result(out)["pictures"]) == 3 and (out / "curves.png").is_file()


def test_train_then_detect(
    tiny_recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(BEVDepthConfig, "tiny", classmethod(lambda cls: CONFIG))
    out = tmp_path / "run"
    words = ["train", str(tiny_recording), "--out", str(out), "--steps", "1", "--batch-size", "1", "--workers", "0"]
    words += ["--cameras-per-sample", "2", "--no-focal-augmentation", "--priors", "IF", "PR", "--projector", "conv1"]
    assert cli.main(words) == 0
    settings = json.loads((out / "run.json").read_text())["settings"]
    assert settings["options"]["priors"] == {
        "inverse_focal": True, "ground_depth": False, "ground_gradient": False, "pluecker": True
    }  # fmt: skip
    assert settings["options"]["focal_augmentation"] is False and settings["options"]["projector"] == "conv1"
    assert settings["options"]["maps"]["reference_focal_px"] == pytest.approx(500 * 96 / 704)
    assert settings["training"]["augment"]["cameras_per_sample"] == 2 and settings["training"]["steps"] == 1
    assert Path(result(out)["pictures"][0]).is_file() and "heatmap" in result(out)["last_losses"]
    assert cli.main(["detect", str(out / "model.safetensors"), str(tiny_recording), "--out", str(tmp_path / "found")]) == 0
    told = capsys.readouterr().out
    assert "trained on tiny for 1 steps" in told
    other = ["train", str(tiny_recording), "--out", str(out), "--steps", "2"]
    assert cli.main(other) == 2
    assert "holds a run with another" in capsys.readouterr().err


def test_weights_of_another_method_are_refused(
    tiny_recording: Path, checkpoint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(BEVDepthConfig, "tiny", classmethod(lambda cls: CONFIG))
    words = ["train", str(tiny_recording), "--out", str(tmp_path), "--method", "direct", "--init", checkpoint, "--steps", "1"]
    assert cli.main(words) == 2
    assert "checkpoint of bevdepth with the method coin3d" in capsys.readouterr().err


def test_check_and_rig(tiny_recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["check", str(tiny_recording), "--out", str(tmp_path / "check"), "--frames", "1"]) == 0
    assert {"boxes", "boxes_with_matching_lidar_count", "findings"} < set(result(tmp_path / "check"))
    assert cli.main(["rig", str(tiny_recording), "--out", str(tmp_path / "rig")]) == 0
    told = capsys.readouterr().out
    assert str(tmp_path / "rig" / "prior_maps.png") in told and (tmp_path / "rig" / "prior_maps.png").is_file()


def test_town(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    # the real one is tested in tests/town; here it only counts what it is told and what is made of its work
    pytest.importorskip("embreex")
    told: dict[str, typing.Any] = {}

    def instead(out: Path, **arguments: typing.Any) -> Path:
        told.update(arguments)
        write_recording(out, scenes=1)
        return out / "preview.png"

    monkeypatch.setattr("coin3d.town.command.town_command", instead)
    assert (
        cli.main(["town", "--out", str(tmp_path / "t"), "--scenes", "1", "--key-frames", "3", "--sweeps", "--width", "64"]) == 0
    )
    assert (told["scenes"], told["key_frames"], told["sweeps"], told["slope"], told["width"]) == (1, 3, True, False, 64)
    assert result(tmp_path / "t")["frames"] == 3 and result(tmp_path / "t")["boxes"] == 4
    assert str(tmp_path / "t" / "preview.png") in capsys.readouterr().out


def test_the_real_frame_as_own_images(
    one_real_frame: Path, checkpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "typed"
    folder.mkdir()
    (folder / "rig.yaml").write_text(RIG_OF_THE_REAL_FRAME)
    frame = open_recording(one_real_frame)[0]
    for name in frame.rig:
        (folder / f"{name}.jpg").symlink_to(Path(str(frame.images[name])).resolve())
    assert cli.main(["check", str(folder), "--out", str(tmp_path / "check")]) == 0
    findings = result(tmp_path / "check")["findings"]
    assert not [f for f in findings if f["severity"] != "note"]
    typed = open_recording(folder)[0].rig
    for name, camera in frame.rig.items():
        assert abs(typed[name].yaw_rad - camera.yaw_rad) % (2 * np.pi) < np.deg2rad(1.5)
    assert cli.main(["detect", checkpoint, str(folder), "--out", str(tmp_path / "out")]) == 0
    assert [Path(p).name for p in result(tmp_path / "out")["pictures"]] == ["typed_cameras.png", "typed_top.png"]


def test_spread_is_even_and_bounded() -> None:
    assert spread(10, 0) == list(range(10)) == spread(10, 99)
    assert spread(10, 1) == [5] and spread(10, 2) == [0, 9] and spread(11, 3) == [0, 5, 10]
    assert spread(0, 3) == []


def test_flags_name_the_projectors_there_are() -> None:
    hints = typing.get_type_hints(CoIn3DFlags)
    assert set(typing.get_args(hints["projector"])) == set(typing.get_args(Projector))


def test_a_rig_is_imported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    chain = tmp_path / "camchain.yaml"
    chain.write_text(
        "cam0: {camera_model: pinhole, intrinsics: [300, 301, 320, 240], distortion_model: equidistant,\n"
        "  distortion_coeffs: [0.01, 0, 0, 0], resolution: [640, 480]}\n",
        encoding="utf-8",
    )
    out = tmp_path / "van" / "rig.yaml"
    arguments = ["rig", "import", str(chain), "--base-pose", "1.5", "0", "1.4", "90", "0", "0", "--out", str(out)]
    assert cli.main(arguments) == 0
    told = capsys.readouterr().out
    assert "cam0: 640 x 480, f 300 px, Fisheye lens, at +1.50 +0.00 +1.40 m, yaw +90 pitch +0 deg" in told
    assert load_rig(out)["cam0"].lens == Fisheye(0.01, 0, 0, 0)
    assert cli.main(arguments) == 2 and "exists already" in capsys.readouterr().err
    matrix = tmp_path / "base.yaml"
    matrix.write_text("[[0, 0, 1, 1.5], [-1, 0, 0, 0], [0, -1, 0, 1.4], [0, 0, 0, 1]]", encoding="utf-8")
    again = tmp_path / "again.yaml"
    assert cli.main(["rig", "import", str(chain), "--base-matrix", str(matrix), "--out", str(again)]) == 0
    assert load_rig(again)["cam0"].yaw_rad == pytest.approx(0)
