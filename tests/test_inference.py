"""coin3d.load(checkpoint).detect(images, rig), and what it refuses."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import coin3d
from checkpoints import write_checkpoint
from coin3d.datasets.open import open_recording
from coin3d.geometry import BrownConrady
from coin3d.geometry.undistort import undistort_image, undistorted_rig
from coin3d.inference import SHIPPED, TOWN_ONLY, WEIGHTS_FOLDER, LoadedDetector
from small_world import ring_rig

RIG = ring_rig(2)
IMAGES = {name: np.random.default_rng(i).integers(0, 255, (64, 96, 3), dtype=np.uint8) for i, name in enumerate(RIG)}


@pytest.fixture(scope="module")
def detector(tmp_path_factory: pytest.TempPathFactory) -> LoadedDetector:
    return coin3d.load(write_checkpoint(tmp_path_factory.mktemp("weights") / "model.safetensors"), "cpu")


def test_import_is_light() -> None:
    code = "import sys, coin3d; print('torch' in sys.modules, 'numpy' in sys.modules, coin3d.Rig.__name__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=_environment())
    assert done.stdout.split() == ["False", "False", "Rig"]


def _environment() -> dict[str, str]:
    source = Path(coin3d.__file__).parents[1]
    return {"PYTHONPATH": str(source), "PATH": ""}


def test_unknown_names_say_what_there_is() -> None:
    with pytest.raises(AttributeError, match="load_rig"):
        coin3d.lod  # noqa: B018
    assert set(coin3d.__all__) <= set(dir(coin3d))


def test_images_from_memory_and_from_files_give_the_same_boxes(detector: LoadedDetector, tmp_path: Path) -> None:
    for name, image in IMAGES.items():
        cv2.imwrite(str(tmp_path / f"{name}.png"), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    from_memory = detector.detect(IMAGES, RIG)
    from_files = detector.detect({name: str(tmp_path / f"{name}.png") for name in RIG}, RIG)
    assert len(from_memory) > 0 and set(from_memory.labels) == {"car"}
    assert (np.diff(from_memory.scores) <= 0).all()
    np.testing.assert_array_equal(from_memory.centre_m, from_files.centre_m)


def test_order_of_the_images_does_not_matter(detector: LoadedDetector) -> None:
    backwards = dict(reversed(IMAGES.items()))
    np.testing.assert_array_equal(detector.detect(IMAGES, RIG).scores, detector.detect(backwards, RIG).scores)


def test_lenses_are_undistorted(detector: LoadedDetector) -> None:
    bent = RIG.with_cameras({name: replace(c, lens=BrownConrady(-0.2, 0.05, 0, 0)) for name, c in RIG.items()})
    straight = {name: undistort_image(image, bent[name]) for name, image in IMAGES.items()}
    expected = detector.detect(straight, undistorted_rig(bent))
    np.testing.assert_array_equal(detector.detect(IMAGES, bent).centre_m, expected.centre_m)
    assert not np.array_equal(detector.detect(IMAGES, RIG).centre_m, expected.centre_m)


@pytest.mark.parametrize(
    ("images", "message"),
    [
        ({"eye0": IMAGES["eye0"]}, "no image of the camera eye1"),
        ({**IMAGES, "eye7": IMAGES["eye0"]}, "image of eye7, but rig 'rig' only has the cameras eye0, eye1"),
        ({**IMAGES, "eye1": IMAGES["eye1"][:32]}, "eye1.* is 96 x 32 pixels but the rig says 96 x 64"),
        ({**IMAGES, "eye1": IMAGES["eye1"].astype(np.float32)}, "eye1: RGB bytes .* float32"),
        ({**IMAGES, "eye1": IMAGES["eye1"][..., 0]}, r"eye1: RGB bytes .* \(64, 96\)"),
        ({**IMAGES, "eye1": "nowhere.png"}, "nowhere.png: the image file is missing"),
    ],
)
def test_wrong_images_are_refused(detector: LoadedDetector, images: dict[str, np.ndarray | str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        detector.detect(images, RIG)


def test_what_a_checkpoint_says_of_itself(detector: LoadedDetector) -> None:
    assert detector.description["method"] == "coin3d" and detector.classes == ("car",)
    assert detector.source == "town_nuscenes"
    assert "trained on town_nuscenes for 3 steps" in detector.note


def test_no_such_checkpoint_or_device(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="shipped name: town-direct, town-coin3d"):
        coin3d.load("town-coin")
    with pytest.raises(ValueError, match="device 'mps:9' cannot be used"):
        coin3d.load(write_checkpoint(tmp_path / "model.safetensors"), "mps:9")


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_weights(name: str) -> None:
    path = WEIGHTS_FOLDER / f"{name}.safetensors"
    if not path.is_file():
        pytest.skip(f"{path} is absent")
    assert path.stat().st_size < 10_000_000
    detector = coin3d.load(name, "cpu")
    assert detector.description["method"] == name.removeprefix("town-")
    assert detector.note == TOWN_ONLY


def test_real_images_typed_rig(detector: LoadedDetector, one_real_frame: Path) -> None:
    frame = open_recording(one_real_frame)[0]
    boxes = detector.detect({name: Path(str(frame.images[name])) for name in frame.rig}, frame.rig)
    assert len(boxes) > 0 and np.isfinite(boxes.centre_m).all()


def test_other_number_formats_and_compiled_trunks_give_nearly_the_same(tmp_path: Path) -> None:
    path = write_checkpoint(tmp_path / "model.safetensors")
    exact = coin3d.load(path, "cpu")
    detectors = exact, coin3d.load(path, "cpu", precision="bfloat16"), coin3d.load(path, "cpu", compiled=True)
    scores, half, compiled = (detector.detect(IMAGES, RIG).scores[:5] for detector in detectors)
    np.testing.assert_allclose(half, scores, atol=0.02)
    np.testing.assert_allclose(compiled, scores, atol=1e-4)
    assert not np.array_equal(half, scores)
