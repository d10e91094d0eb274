"""From a recording to files: complete, the same each time, and resumed wherever it stopped."""

import json
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from coin3d.datasets.frame import Frame
from coin3d.datasets.open import open_recording
from coin3d.rendering import load_gaussians, render
from coin3d.scenes.build import BuildOutcome, build_scenes
from coin3d.scenes.options import BuildOptions
from tiny_recording import write_recording

SCENE = "street-0"


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(tmp_path_factory.mktemp("recording") / "tiny", scenes=1, samples=2)


@pytest.fixture(scope="module")
def built(recording: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, BuildOutcome]:
    out = tmp_path_factory.mktemp("scenes")
    return out, build(recording, out)


def build(recording: Path, out: Path, **options: Any) -> BuildOutcome:
    return build_scenes(open_recording(recording), out, BuildOptions(**options), progress=lambda line: None)


def contents(out: Path) -> dict[str, bytes]:
    return {str(p.relative_to(out)): p.read_bytes() for p in out.rglob("*") if p.is_file() and p.name != "timing.json"}


def test_every_key_frame_has_gaussians_and_figures(built: tuple[Path, BuildOutcome]) -> None:
    out, outcome = built
    assert [frame.token for frame in outcome.frames] == ["sample0.0", "sample0.1"]
    pixels = 3 * 96 * 64
    for frame in outcome.frames:
        gaussians = load_gaussians(out / SCENE / f"{frame.token}.safetensors")
        assert len(gaussians) == frame.gaussians
        assert 0.9 * pixels < len(gaussians) < 6 * pixels
        assert np.isfinite(gaussians.centre_m).all()
        assert frame.mesh + frame.lidar + frame.completed + frame.sky == pytest.approx(1, abs=1e-4)
        assert frame.known_below_horizon > 0.2
        assert frame.psnr_db > 25
        assert frame.empty_below_horizon < 0.02
    written = json.loads((out / "scenes.json").read_text())
    assert written["scenes"][0]["name"] == SCENE
    assert written["scenes"][0]["frames"][1]["psnr_db"] == outcome.frames[1].psnr_db
    timing = json.loads((out / "timing.json").read_text())
    assert {"meshes", "depth", "object models", "blind area", "Gaussians", "quality"} <= set(timing["seconds"])
    assert (out / SCENE / "sheet.png").stat().st_size > 10_000
    assert not (out / SCENE / "depth").exists(), "what only the build needs is gone"
    assert not list(out.rglob("*.part"))


@pytest.mark.parametrize("lost", ["sample0.1.safetensors", "quality/sample0.0.json", "objects.safetensors", "meshes"])
def test_a_build_that_stopped_anywhere_ends_with_the_same_bytes(
    lost: str, recording: Path, built: tuple[Path, BuildOutcome], tmp_path: Path
) -> None:
    """Later steps' files are there only if earlier ones are, so what follows the lost one is lost as well."""
    whole = contents(built[0])
    after = {"objects.safetensors": ("quality",), "meshes": ("quality", "objects.safetensors")}.get(lost, ())
    for name, data in whole.items():
        if not any(name.startswith(f"{SCENE}/{gone}") for gone in (lost, *after)):
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_bytes(data)
    build(recording, tmp_path)
    assert contents(tmp_path) == whole


def test_a_finished_build_is_not_done_again(recording: Path, built: tuple[Path, BuildOutcome]) -> None:
    before = {p: p.stat().st_mtime_ns for p in built[0].rglob("*.safetensors")}
    outcome = build(recording, built[0])
    assert outcome.frames == built[1].frames
    assert outcome.seconds == {}
    assert {p: p.stat().st_mtime_ns for p in built[0].rglob("*.safetensors")} == before


def test_another_build_into_the_same_folder_is_refused(recording: Path, built: tuple[Path, BuildOutcome]) -> None:
    with pytest.raises(ValueError, match="other width_px"):
        build(recording, built[0], width_px=64)


def test_several_processes_give_the_same_bytes(recording: Path, built: tuple[Path, BuildOutcome], tmp_path: Path) -> None:
    build_scenes(open_recording(recording), tmp_path, BuildOptions(), workers=2, progress=lambda line: None)
    assert contents(tmp_path) == contents(built[0])


class Changed:
    """A recording whose frames were changed."""

    def __init__(self, frames: list[Frame]) -> None:
        self.frames = frames

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> Frame:
        return self.frames[index]

    def __iter__(self) -> Iterator[Frame]:
        return iter(self.frames)


def test_scenes_without_lidar_are_built_but_kept_raw(recording: Path, tmp_path: Path) -> None:
    frames = [replace(frame, lidar=None) for frame in open_recording(recording)]
    outcome = build_scenes(Changed(frames), tmp_path, BuildOptions(), progress=lambda line: None)
    assert "LiDAR" in outcome.raw_only[SCENE]
    assert all(frame.mesh == 0 for frame in outcome.frames)


def test_recordings_without_boxes_are_refused(recording: Path, tmp_path: Path) -> None:
    frames = [replace(frame, boxes_world=None) for frame in open_recording(recording)]
    with pytest.raises(ValueError, match=r"sample0.0 has no boxes"):
        build_scenes(Changed(frames), tmp_path, progress=lambda line: None)


@pytest.mark.parametrize("option", [{"width_px": 4}, {"voxel_m": 0.0}, {"neighbours": -1}, {"sharpen": -1}])
def test_options_that_make_no_sense(option: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(option))):
        BuildOptions(**option)


def test_a_damaged_file_is_named(recording: Path, tmp_path: Path) -> None:
    build(recording, tmp_path, keep_depth=True)
    depth = tmp_path / SCENE / "depth" / "sample0.0.safetensors"
    depth.write_bytes(depth.read_bytes()[:500])
    (tmp_path / SCENE / "quality" / "sample0.0.json").unlink()
    (tmp_path / SCENE / "objects.safetensors").unlink()
    with pytest.raises(ValueError, match=r"sample0.0.safetensors: cannot be read"):
        build(recording, tmp_path, keep_depth=True)


def test_the_own_vehicle_is_no_part_of_the_scene(recording: Path, tmp_path: Path) -> None:
    """A bonnet, painted green, at the bottom of the front camera: with a mask the street goes on where it was."""

    def with_bonnet(frame: Frame, masked: bool) -> Frame:
        image, mask = frame.image("CAM_FRONT").copy(), np.zeros((64, 96), np.uint8)
        image[48:, 20:70], mask[48:, 20:70] = (0, 255, 0), 1
        own_vehicle = {"CAM_FRONT": mask} if masked else {}
        return replace(frame, images={**frame.images, "CAM_FRONT": image}, own_vehicle=own_vehicle)

    greens = {}
    for masked in (True, False):
        frames = [with_bonnet(frame, masked) for frame in open_recording(recording)]
        outcome = build_scenes(Changed(frames), tmp_path / str(masked), progress=lambda line: None)
        gaussians = load_gaussians(tmp_path / str(masked) / SCENE / "sample0.0.safetensors")
        greens[masked] = int(((gaussians.rgb[:, 1] > 200) & (gaussians.rgb[:, 0] < 60)).sum())
        assert outcome.frames[0].empty_below_horizon < 0.02
        if masked:
            (front,) = render(gaussians, [frames[0].rig["CAM_FRONT"]])
            assert (front.alpha[48:, 20:70] > 0.5).mean() > 0.9
    assert greens[False] > 700 and greens[True] == 0


def test_masks_are_found_beside_a_recording(recording: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(recording, tmp_path / "tiny")
    (copy / "own_vehicle").mkdir()
    mask = np.zeros((64, 96), np.uint8)
    mask[60:] = 255
    cv2.imwrite(str(copy / "own_vehicle" / "CAM_BACK.png"), mask)
    frame = open_recording(copy)[0]
    assert frame.own_vehicle_mask("CAM_BACK").sum() == 4 * 96 and not frame.own_vehicle_mask("CAM_FRONT").any()
    cv2.imwrite(str(copy / "own_vehicle" / "CAM_BACK.png"), mask[:10])
    with pytest.raises(ValueError, match=r"own vehicle .*CAM_BACK.png is 96 x 10 pixels but the rig says 96 x 64"):
        frame.own_vehicle_mask("CAM_BACK")
