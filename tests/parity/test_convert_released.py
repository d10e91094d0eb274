"""``coin3d convert`` from the file to boxes: names and shapes are those of the released files, numbers are made up."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from parity_files import released_shapes
from torch import Tensor

from coin3d import cli
from coin3d.training.checkpoint import load_checkpoint, read_description
from coin3d.training.released.sources import source_named
from small_world import batch, ring_rig, sample


def written(path: Path, key_list: str, **beside: Any) -> dict[str, Tensor]:
    """Save a released file with numbers that keep activations of every depth finite, equal where copies are."""
    generator, weights = torch.Generator().manual_seed(0), {}
    for name, shape in released_shapes(key_list).items():
        last = name.rpartition(".")[2]
        if last == "num_batches_tracked":
            weights[name] = torch.tensor(5)
        elif (first := re.sub(r"_branches\.\d\.", "_branches.0.", name)) in weights and key_list == "petr_keys.txt":
            weights[name] = weights[first]
        elif len(shape) < 2:
            weights[name] = (torch.ones if last in ("weight", "running_var") else torch.zeros)(shape)
        else:
            row = torch.randn(1, *shape[1:], generator=generator) / np.prod(shape[1:]) ** 0.5
            weights[name] = row.expand(shape)  # equal rows take little room in the file
    torch.save({"state_dict": weights, **beside} if beside else weights, path)
    return weights


@pytest.mark.parametrize(
    ("name", "key_list", "beside", "told"),
    [
        ("bevformer-tiny", "bevformer_keys.txt", {"meta": {"epoch": 24}}, "names and shapes are those of bevformer-tiny alone"),
        ("petr-vov-mmdet3d", "petr_keys.txt", {"meta": {}, "param_schedulers": []}, "773 of 854 weights mapped"),
        ("coin3d-waymo", "coin3d_bevdet_keys.txt", {}, "601 of 601 weights mapped"),
        ("megvii-2key-da", "bevdepth_2key_da_keys.txt", {"epoch": 20}, "those of megvii-2key-da alone"),
    ],
)
def test_from_a_released_file_to_boxes(
    name: str, key_list: str, beside: dict[str, Any], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "released.pth", tmp_path / "w" / "ours.safetensors"
    released = written(path, key_list, **beside)
    words = ["convert", str(path), str(out), *([] if "alone" in told else ["--from", name])]
    assert cli.main(words) == 0
    assert told in capsys.readouterr().out
    assert sorted(p.name for p in out.parent.iterdir()) == ["ours.result.json", "ours.safetensors"]
    source, result = source_named(name), json.loads((out.parent / "ours.result.json").read_text())
    assert result["weights_mapped"] + len(result["left_out"]) == result["weights_read"] == len(released)
    assert result["from"] == name and len(result["sha256"]) == 64

    model, description = load_checkpoint(out)
    assert model.config == source.config and model.classes == source.classes
    assert description == read_description(out) and description["notes"] == source.notes
    expected = source.convert(released)
    assert all(torch.equal(tensor, expected[key]) for key, tensor in model.state_dict().items())
    (boxes,) = model.detect(batch(sample(0, ring_rig(6))))
    assert np.isfinite(boxes.centre_m).all() and set(map(str, boxes.labels)) <= set(source.classes)
    assert len(boxes) == 300 or source.detector == "bevdepth"


def test_files_that_could_be_several_are_not_guessed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = tmp_path / "released.pth", tmp_path / "w" / "ours.safetensors"
    written(path, "petr_keys.txt")
    assert cli.main(["convert", str(path), str(out)]) == 2
    assert "say with --from which it is: petr-vov: " in capsys.readouterr().err and not out.parent.exists()
