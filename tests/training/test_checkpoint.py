"""Checkpoints: built again from the file alone, and clear words for files that are not what they should be."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file, save

from coin3d.augmentation import FocalAugmentation
from coin3d.detectors import BEVDepth
from coin3d.methods import METHODS, CoIn3DOptions
from coin3d.priors import PriorSet
from coin3d.training.checkpoint import describe, load_checkpoint, load_weights, read_description, save_checkpoint
from small_world import CLASSES, CONFIG, batch, detector, ring_rig, sample, settled

UNUSUAL = CoIn3DOptions(
    placement="paper", priors=PriorSet(ground_gradient=False), projector="conv1", focal=FocalAugmentation(0.8, 1.1)
)


def written(
    path: Path, model: BEVDepth, method: str, options: Any = None, *, half: bool = False, changed: dict[str, Any] | None = None
) -> Path:
    options = METHODS[method][0]() if options is None else options
    description = {**describe("bevdepth", CONFIG, CLASSES, method, options, "a note"), **(changed or {})}
    save_checkpoint(path, model.state_dict(), description, half=half)
    return path


@pytest.mark.parametrize(("method", "options"), [("none", None), ("direct", None), ("coin3d", None), ("coin3d", UNUSUAL)])
def test_a_detector_comes_back_from_its_file(method: str, options: Any, tmp_path: Path) -> None:
    one = batch(sample(0, ring_rig(3)))
    model = settled(detector(method, options, seed=5), one)
    path = written(tmp_path / "sub" / "model.safetensors", model, method, options)
    back, description = load_checkpoint(path)
    assert not back.training and back.classes == CLASSES and back.config == CONFIG
    if method == "coin3d":
        assert back.method.options == (options or CoIn3DOptions())
    assert description == read_description(path) and description["notes"] == "a note"
    with torch.no_grad():
        assert torch.equal(model(one)["heatmap"], back(one)["heatmap"])
    assert [p.name for p in path.parent.iterdir()] == ["model.safetensors"]


def test_half_storage_halves_the_file_and_hardly_moves_the_output(tmp_path: Path) -> None:
    one = batch(sample(0, ring_rig(3)))
    model = settled(detector("coin3d"), one)
    whole, half = written(tmp_path / "whole", model, "coin3d"), written(tmp_path / "half", model, "coin3d", half=True)
    assert half.stat().st_size < 0.52 * whole.stat().st_size
    dtypes = {name: t.dtype for name, t in load_file(half).items()}
    assert dtypes["head.shared_conv.0.weight"] == torch.float16
    assert dtypes["head.shared_conv.1.running_var"] == torch.float32  # may exceed what 16 bits hold
    assert dtypes["head.shared_conv.1.num_batches_tracked"] == torch.int64
    back, _ = load_checkpoint(half)
    assert {p.dtype for p in back.parameters()} == {torch.float32}
    with torch.no_grad():
        found, expected = back(one)["heatmap"], model(one)["heatmap"]
    assert 0 < (found - expected).std() < 0.02 * expected.std()


def test_channels_last_weights_are_stored_plainly(tmp_path: Path) -> None:
    model = detector("none").to(memory_format=torch.channels_last)
    path = written(tmp_path / "m", model, "none")
    assert torch.equal(load_file(path)["head.shared_conv.0.weight"], model.state_dict()["head.shared_conv.0.weight"])


def test_loading_never_asks_for_pretrained_weights(tmp_path: Path) -> None:
    """Downloading ImageNet weights only to overwrite them would make detection need a network."""
    config = {**describe("bevdepth", CONFIG, CLASSES, "none", METHODS["none"][0]())["config"], "pretrained": True}
    path = written(tmp_path / "m", detector("none"), "none", changed={"config": config})
    assert not load_checkpoint(path)[0].config.pretrained


def test_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"absent\.safetensors: no such checkpoint"):
        load_checkpoint(tmp_path / "absent.safetensors")


@pytest.mark.parametrize("keep", [0, 7, 1000, -10])
def test_truncated_file(keep: int, tmp_path: Path) -> None:
    path = written(tmp_path / "m", detector("none"), "none")
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(ValueError, match="not a complete safetensors file"):
        load_checkpoint(path)


def test_file_of_another_program(tmp_path: Path) -> None:
    path = tmp_path / "m"
    path.write_bytes(save({"weight": torch.zeros(3)}))
    with pytest.raises(ValueError, match="not a checkpoint made by coin3d"):
        load_checkpoint(path)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"format": 2}, "checkpoint format 2, this version reads 1"),
        ({"format": None}, "checkpoint format None"),
        ({"detector": "yolo"}, "made with the detector 'yolo', known are bevdepth"),
        ({"method": "magic"}, "made with the method 'magic', known are none, direct"),
        ({"config": {"wheels": 4}}, "m: .*has no field wheels"),
        ({"options": {"placement": "everywhere"}}, "m: .*placement is one of 'released', 'paper'"),
        ({"classes": ["car"]}, "has shape"),
    ],
)
def test_descriptions_that_do_not_fit(changed: dict[str, Any], message: str, tmp_path: Path) -> None:
    path = written(tmp_path / "m", detector("coin3d"), "coin3d", changed=changed)
    with pytest.raises(ValueError, match=message):
        load_checkpoint(path)


@pytest.mark.parametrize("missing", ["detector", "classes", "options"])
def test_descriptions_that_lack_something(missing: str, tmp_path: Path) -> None:
    path = tmp_path / "m"
    description = describe("bevdepth", CONFIG, CLASSES, "none", METHODS["none"][0]())
    del description[missing]
    path.write_bytes(save(detector("none").state_dict(), metadata={"coin3d": json.dumps(description)}))
    with pytest.raises(ValueError, match=f"m: the description .*lacks {missing}"):
        load_checkpoint(path)


def test_weights_of_another_method_or_size(tmp_path: Path) -> None:
    path = written(tmp_path / "m", detector("direct"), "direct")
    with pytest.raises(ValueError, match=r"bevdepth with the method direct: it has the extra weight 'depth_net\."):
        load_weights(detector("none"), path)
    path = written(tmp_path / "m", detector("none"), "none")
    with pytest.raises(ValueError, match=r"it lacks weight .*names differ"):
        load_weights(detector("direct"), path)
    with pytest.raises(ValueError, match=r"'backbone.trunk.conv1.weight' has shape .* this detector needs"):
        load_weights(detector("coin3d", CoIn3DOptions(modulate=False)), path)


def test_weights_may_start_another_training(tmp_path: Path) -> None:
    donor, heir = detector("coin3d", seed=1), detector("coin3d", seed=2)
    load_weights(heir, written(tmp_path / "m", donor, "coin3d", half=False))
    assert all(torch.equal(a, b) for a, b in zip(donor.parameters(), heir.parameters(), strict=True))
