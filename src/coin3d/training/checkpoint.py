"""Checkpoints: one safetensors file that knows how to build its detector. Nothing in it is ever executed."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from coin3d.detectors import DETECTORS, TRAINABLE, Detector
from coin3d.methods import METHODS
from coin3d.records import from_plain, to_plain, write_bytes
from coin3d.training.build_guard import build_within

FORMAT = 1
_TRUNK = "backbone."


def build_detector(detector: str, config: Any, classes: tuple[str, ...], method: str, options: Any) -> Detector:
    """A fresh detector with a method attached."""
    make_detector: Callable[..., Detector] = TRAINABLE[detector][1]
    _, make_method = METHODS[method]
    return make_detector(config, classes, make_method(options))


def describe(
    detector: str, config: Any, classes: tuple[str, ...], method: str, options: Any, notes: str = ""
) -> dict[str, Any]:
    """What, beside the weights, a checkpoint needs to build its detector again."""
    return {
        "format": FORMAT,
        "detector": detector,
        "config": to_plain(config),
        "classes": list(classes),
        "method": method,
        "options": to_plain(options),
        "notes": notes,
    }


def save_checkpoint(path: Path, weights: dict[str, Tensor], description: dict[str, Any], *, half: bool = False) -> None:
    """Write weights and description atomically; ``half`` stores floating-point weights in 16 bits (for shipping)."""
    tensors = {}
    for name, tensor in weights.items():
        shrink = half and tensor.dtype == torch.float32 and "running_" not in name
        tensors[name] = (tensor.half() if shrink else tensor).detach().cpu().contiguous()
    write_bytes(path, save(tensors, metadata={"coin3d": json.dumps(description)}))


def read_description(path: Path) -> dict[str, Any]:
    """The description of a checkpoint, without reading its weights.

    Raises:
        FileNotFoundError: no such file.
        ValueError: not a checkpoint of this project, or of a newer format.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such checkpoint")
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
    except (SafetensorError, OSError) as error:
        raise ValueError(f"{path}: not a complete safetensors file ({error}); is it truncated?") from error
    if "coin3d" not in metadata:
        raise ValueError(f"{path}: a safetensors file, but not a checkpoint made by coin3d train or convert")
    description = _parsed(metadata["coin3d"], path)
    if description.get("format") != FORMAT:
        raise ValueError(f"{path}: checkpoint format {description.get('format')}, this version reads {FORMAT}")
    if missing := [key for key in ("detector", "config", "classes", "method", "options") if key not in description]:
        raise ValueError(f"{path}: the description in the checkpoint lacks {', '.join(missing)}")
    kinds = {"config": dict, "options": dict, "classes": list}
    if wrong := [key for key, kind in kinds.items() if not isinstance(description[key], kind)]:
        raise ValueError(f"{path}: {', '.join(wrong)} in the description of the checkpoint make no sense; is it damaged?")
    if not all(isinstance(name, str) for name in description["classes"]):
        raise ValueError(f"{path}: the classes in the description of the checkpoint are no names; is it damaged?")
    return description


def _parsed(text: str, path: Path) -> dict[str, Any]:
    try:
        description = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: the description in the checkpoint is not JSON ({error}); is it damaged?") from error
    if not isinstance(description, dict):
        raise ValueError(f"{path}: the description in the checkpoint is no set of fields; is it damaged?")
    return description


def load_checkpoint(path: Path) -> tuple[Detector, dict[str, Any]]:
    """Build the detector a checkpoint describes and load its weights (float32, evaluation mode).

    Raises:
        ValueError: unknown detector or method, or weights that do not belong to them.
    """
    d = read_description(path)
    if d["detector"] == "trunk":
        raise ValueError(f"{path}: a pre-trained trunk, which detects nothing; give it to coin3d train --trunk")
    for key, known in (("detector", DETECTORS), ("method", METHODS)):
        if not isinstance(d[key], str) or d[key] not in known:
            raise ValueError(f"{path}: made with the {key} '{d[key]}', known are {', '.join(known)}")
    try:
        config: Any = from_plain(DETECTORS[d["detector"]][0], {**d["config"], "pretrained": False})
        options: Any = from_plain(METHODS[d["method"]][0], d["options"])
    except (ValueError, TypeError, ArithmeticError, LookupError, AttributeError) as error:  # a stride of 0 divides something
        raise ValueError(f"{path}: the description in the checkpoint makes no sense: {error}") from error
    if not re.fullmatch(r"\w[\w.-]{0,79}", str(getattr(config, "backbone", "none"))):  # some names make timm ask the network
        raise ValueError(f"{path}: made with the backbone '{config.backbone:.80}', which is no name of a network")
    model = build_within(
        lambda: build_detector(d["detector"], config, tuple(d["classes"]), d["method"], options),
        _shapes_in(path),
        str(path),
    )
    load_weights(model, path)
    return model.eval(), d


def load_weights(model: Detector, path: Path) -> None:
    """Load a checkpoint's weights into a detector of the same shape.

    Raises:
        ValueError: weights that are missing, unknown or of another shape, naming the first.
    """
    description, weights = read_description(path), _tensors(path)
    own = model.state_dict()
    if wrong := sorted(set(own) ^ set(weights)):
        side = "lacks" if wrong[0] in own else "has the extra"
        raise ValueError(
            f"{path} is a checkpoint of {description['detector']} with the method {description['method']}: it {side} "
            f"weight '{wrong[0]}' ({len(wrong)} names differ); choose the same detector, preset and method"
        )
    for name, tensor in weights.items():
        if tensor.shape != own[name].shape:
            raise ValueError(f"{path}: '{name}' has shape {tuple(tensor.shape)}, this detector needs {tuple(own[name].shape)}")
    model.load_state_dict({name: tensor.to(own[name].dtype) for name, tensor in weights.items()})


def load_trunk(model: Detector, path: Path) -> None:
    """Start the image trunk of a detector from that of a pre-training (``coin3d pretrain``) or of another detector.

    Where a method gives the trunk more input channels, those keep their own start.

    Raises:
        FileNotFoundError: no such file.
        ValueError: a trunk of another shape.
    """
    description, weights = read_description(path), _tensors(path)
    own = {name: tensor for name, tensor in model.state_dict().items() if name.startswith(_TRUNK)}
    first = "backbone.trunk.conv1.weight"
    if first in own and first in weights and own[first].shape[1] > weights[first].shape[1]:
        weights[first] = torch.cat([weights[first], own[first][:, weights[first].shape[1] :].to(weights[first])], dim=1)
    for name, tensor in own.items():
        if name not in weights or weights[name].shape != tensor.shape:
            raise ValueError(
                f"{path}: the trunk of this {description['detector']} does not fit: this detector needs '{name}' of shape "
                f"{tuple(tensor.shape)}; pre-train with the same detector and preset (coin3d pretrain)"
            )
    model.load_state_dict({name: weights[name].to(tensor.dtype) for name, tensor in own.items()}, strict=False)


def _shapes_in(path: Path) -> list[list[int]]:
    with safe_open(path, framework="pt") as file:
        return [file.get_slice(name).get_shape() for name in file.keys()]  # noqa: SIM118


def _tensors(path: Path) -> dict[str, Tensor]:
    try:
        with safe_open(path, framework="pt") as file:
            return {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, RuntimeError, TypeError, AttributeError) as error:
        raise ValueError(f"{path}: its weights cannot be read ({error}); is it damaged?") from error
