"""Damaged checkpoints: headers, descriptions and weights that are not what they say."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from coin3d.training.checkpoint import describe, load_checkpoint, read_description, save_checkpoint
from fuzzing import broken_json, damaged, refused
from small_world import CLASSES, CONFIG

OPTIONS: dict[str, Any] = {}


def file_with(path: Path, header: bytes, length: int | None = None) -> Path:
    """A safetensors file with any header and eight bytes of numbers."""
    path.write_bytes(struct.pack("<Q", len(header) if length is None else length) + header + bytes(8))
    return path


def header_with(description: str) -> bytes:
    one = {"dtype": "F32", "shape": [2], "data_offsets": [0, 8]}
    return json.dumps({"__metadata__": {"coin3d": description}, "w": one}).encode()


def good() -> dict[str, Any]:
    return describe("bevdepth", CONFIG, CLASSES, "none", OPTIONS)


def test_headers_cut_off_or_flipped(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    path = tmp_path / "model.safetensors"
    whole = file_with(path, header_with(json.dumps(good()))).read_bytes()
    assert read_description(path)["detector"] == "bevdepth"
    for _ in range(300):
        path.write_bytes(damaged(whole, rng))
        refused(lambda: read_description(path), str(path))


@pytest.mark.parametrize("length", [0, 1, 2**27, 2**40, 2**63, 2**64 - 1])
def test_headers_of_any_length(tmp_path: Path, length: int) -> None:
    path = file_with(tmp_path / "model.safetensors", header_with(json.dumps(good())), length)
    assert refused(lambda: read_description(path), str(path)) is None


@pytest.mark.parametrize(
    "tensor",
    [
        {"dtype": "F32", "shape": [2**40], "data_offsets": [0, 8]},
        {"dtype": "F32", "shape": [2**62, 4], "data_offsets": [0, 8]},
        {"dtype": "F32", "shape": [2], "data_offsets": [0, 2**40]},
        {"dtype": "F32", "shape": [2], "data_offsets": [8, 0]},
        {"dtype": "F99", "shape": [2], "data_offsets": [0, 8]},
        {"dtype": "F32", "shape": "2", "data_offsets": [0, 8]},
        {"dtype": "F32"},
        7,
    ],
)
def test_weights_that_are_not_there(tmp_path: Path, tensor: Any) -> None:
    header = json.dumps({"__metadata__": {"coin3d": json.dumps(good())}, "w": tensor}).encode()
    path = file_with(tmp_path / "model.safetensors", header)
    assert refused(lambda: load_checkpoint(path), str(path)) is None


@pytest.mark.parametrize(
    "description",
    [
        "", "{", "7", "null", "[]", '"x"', "[" * 50_000, '{"format": 1' + "0" * 5000 + "}", '{"format": true}', '{"format": 1}',
    ],
)  # fmt: skip
def test_descriptions_that_are_none(tmp_path: Path, description: str) -> None:
    path = file_with(tmp_path / "model.safetensors", header_with(description))
    assert refused(lambda: read_description(path), str(path)) is None


def test_descriptions_with_values_that_make_no_sense(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever comes as far as to the building of a network is stopped there."""

    def refuse(build: Callable[[], object], shapes: list[list[int]], where: str) -> None:
        raise ValueError(f"{where}: {len(shapes)} weights")

    monkeypatch.setattr("coin3d.training.checkpoint.build_within", refuse)
    rng = np.random.default_rng(1)
    path = tmp_path / "model.safetensors"
    for _ in range(150):
        text, _ = broken_json(good(), rng)
        file_with(path, header_with(text))
        assert refused(lambda: load_checkpoint(path), str(path)) is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"detector": ["bevdepth"]}, "made with the detector"),
        ({"detector": "yolo"}, "made with the detector 'yolo'"),
        ({"method": {}}, "made with the method"),
        ({"classes": "car"}, "classes in the description of the checkpoint make no sense"),
        ({"classes": ["car", 7]}, "are no names"),
        ({"config": []}, "config in the description"),
        ({"options": 3}, "options in the description"),
    ],
)
def test_what_must_not_pass(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    path = tmp_path / "model.safetensors"
    save_checkpoint(path, {"w": torch.zeros(2)}, {**good(), **change})
    with pytest.raises(ValueError, match=message) as caught:
        load_checkpoint(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"neck_channels": 10**7}, "a far larger network"),
        ({"bev_channels": 60_000, "head_channels": 60_000}, "a far larger network"),
        ({"depth_blocks": 10**9}, "a far larger network"),
        ({"backbone": "hf-hub:somebody/something"}, "no name of a network"),
        ({"backbone": "../weights"}, "no name of a network"),
        ({"backbone": "resnet999"}, "no detector can be built"),
        ({"strides": [0, 16]}, "makes no sense|no detector can be built"),
        ({"neck_channels": -1}, "no detector can be built"),
        ({"context_channels": 0}, "no detector can be built|weight|shape"),
    ],
)
def test_networks_that_no_weights_are_of(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    """Refused before the memory for them is taken."""
    path = tmp_path / "model.safetensors"
    description = good()
    save_checkpoint(path, {"w": torch.zeros(2)}, {**description, "config": {**description["config"], **changes}})
    with pytest.raises(ValueError, match=message) as caught:
        load_checkpoint(path)
    assert str(path) in str(caught.value)
