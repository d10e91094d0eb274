"""PETR-VoV: which released weight becomes which of ours, and what is rearranged on the way (spec detectors 2, 3)."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Literal

import torch
from torch import Tensor

Source = Literal["authors", "mmdet3d"]
"""Whose file: the authors' stores (log width, log length), the port to mmdet3d (log length, log width)."""

_PARTS = ("conv", "norm")
_HEAD = "pts_bbox_head."
_LAYER = _HEAD + "transformer.decoder.layers."
_FEED_FORWARD = {"0": "0.0", "3": "1"}
_NAMES: tuple[tuple[str, Callable[[re.Match[str]], str]], ...] = (
    (r"backbone\.stem\.(\d)\.(\d)\.(.+)", lambda m: f"img_backbone.stem.stem_{int(m[1]) + 1}/{_PARTS[int(m[2])]}.{m[3]}"),
    (
        r"backbone\.stages\.(\d)\.(\d)\.layers\.(\d)\.(\d)\.(.+)",
        lambda m: f"{_stage(m)}.layers.{m[3]}.{_block(m)}_{m[3]}/{_PARTS[int(m[4])]}.{m[5]}",
    ),
    (
        r"backbone\.stages\.(\d)\.(\d)\.join\.(\d)\.(.+)",
        lambda m: f"{_stage(m)}.concat.{_block(m)}_concat/{_PARTS[int(m[3])]}.{m[4]}",
    ),
    (r"backbone\.stages\.(\d)\.(\d)\.gate\.(.+)", lambda m: f"{_stage(m)}.ese.fc.{m[3]}"),
    (r"neck\.lateral_convs\.(\d)\.(.+)", lambda m: f"img_neck.lateral_convs.{m[1]}.conv.{m[2]}"),
    (r"neck\.out_conv\.(.+)", lambda m: f"img_neck.fpn_convs.0.conv.{m[1]}"),
    (r"((?:input_proj|query_embedding)\..+)", lambda m: f"{_HEAD}{m[1]}"),
    (r"rays\.mlp\.(.+)", lambda m: f"{_HEAD}position_encoder.{m[1]}"),
    (r"camera_sine\.mlp\.(.+)", lambda m: f"{_HEAD}adapt_pos3d.{m[1]}"),
    (r"reference_points", lambda m: f"{_HEAD}reference_points.weight"),
    (r"class_branch\.(.+)", lambda m: f"{_HEAD}cls_branches.0.{m[1]}"),
    (r"box_branch\.(.+)", lambda m: f"{_HEAD}reg_branches.0.{m[1]}"),
    (r"decoder\.layers\.(\d+)\.among_queries\.(.+)", lambda m: f"{_LAYER}{m[1]}.attentions.0.attn.{m[2]}"),
    (r"decoder\.layers\.(\d+)\.to_memory\.(.+)", lambda m: f"{_LAYER}{m[1]}.attentions.1.attn.{m[2]}"),
    (
        r"decoder\.layers\.(\d+)\.feed_forward\.([03])\.(.+)",
        lambda m: f"{_LAYER}{m[1]}.ffns.0.layers.{_FEED_FORWARD[m[2]]}.{m[3]}",
    ),
    (r"decoder\.layers\.(\d+)\.norms\.(.+)", lambda m: f"{_LAYER}{m[1]}.norms.{m[2]}"),
    (r"decoder\.norm\.(.+)", lambda m: f"{_HEAD}transformer.decoder.post_norm.{m[1]}"),
)
_SHARED_COPY = re.compile(_HEAD.replace(".", r"\.") + r"((?:cls|reg)_branches)\.[1-9]\d*\.(.+)")


def released_name(ours: str) -> str:
    """The released name of one of our weights.

    Raises:
        ValueError: PETR has no such weight.
    """
    for pattern, rename in _NAMES:
        if found := re.fullmatch(pattern, ours):
            return rename(found)
    raise ValueError(f"'{ours}' is no weight of a released PETR-VoV")


def left_out(released: str) -> str | None:
    """Why a released weight has no counterpart, or None if it must have one."""
    if _SHARED_COPY.fullmatch(released):
        return "a copy of the branch that all decoder layers share"
    if released == f"{_HEAD}code_weights":
        return "weights of the loss, which are part of the configuration"
    return None


def convert_petr(
    released: Mapping[str, Tensor], expected: Mapping[str, Tensor], source: Source = "authors"
) -> dict[str, Tensor]:
    """Weights for ``PETR(PETRConfig.released_nuscenes(), ...)``.

    The converted network reads RGB where the released one read BGR, and its boxes are coded as all of ours are.

    Args:
        released: the released weights by name.
        expected: the state dict of the detector they are for; only its shapes are read.
        source: whose file.

    Raises:
        ValueError: a weight that is unknown, missing, of another shape or, of a shared branch, differs between its copies.
    """
    names = {ours: released_name(ours) for ours in expected}
    if missing := [name for name in names.values() if name not in released]:
        raise ValueError(f"the file lacks '{missing[0]}' ({len(missing)} weights missing): it is no complete PETR-VoV")
    for name in released.keys() - set(names.values()):
        if left_out(name) is None:
            raise ValueError(f"the file has '{name}', which is no weight of PETR-VoV: it belongs to another detector")
        _check_copy(name, released)
    for ours, name in names.items():
        if (found := tuple(released[name].shape)) != (wanted := tuple(expected[ours].shape)):
            raise ValueError(f"'{name}' has the shape {found} instead of {wanted}: the file is of another size of PETR")
    return _rearranged({ours: released[name].to(expected[ours].dtype) for ours, name in names.items()}, source)


def box_rows(source: Source) -> tuple[list[int], list[float]]:
    """Rows of the last regression layer in the order of our code, and their signs.

    The released yaw is -yaw - pi/2, so that sin(yaw) = -cos(released) and cos(yaw) = -sin(released).
    """
    size = [3, 2] if source == "authors" else [2, 3]
    return [0, 1, *size, 4, 5, 7, 6, 8, 9], [1.0] * 6 + [-1.0, -1.0, 1.0, 1.0]


def _rearranged(converted: dict[str, Tensor], source: Source) -> dict[str, Tensor]:
    weight, bias, first = "box_branch.4.weight", "box_branch.4.bias", "backbone.stem.0.0.weight"
    sine = "camera_sine.mlp.0.weight"
    rows, signs = box_rows(source)
    sign = torch.tensor(signs)
    # of camera, row and column the released code lists all sines, then all cosines; we let them alternate
    of_three = converted[sine].flatten(1).unflatten(1, (3, 2, -1))
    return {
        **converted,
        weight: converted[weight][rows] * sign[:, None],
        bias: converted[bias][rows] * sign,
        first: converted[first].flip(1),
        sine: of_three.transpose(2, 3).reshape(converted[sine].shape),
    }


def _check_copy(name: str, released: Mapping[str, Tensor]) -> None:
    if found := _SHARED_COPY.fullmatch(name):
        original = f"{_HEAD}{found[1]}.0.{found[2]}"
        if original not in released or not torch.equal(released[name], released[original]):
            raise ValueError(f"'{name}' differs from '{original}': PETR shares one branch among its decoder layers")


def _block(match: re.Match[str]) -> str:
    return f"OSA{int(match[1]) + 2}_{int(match[2]) + 1}"


def _stage(match: re.Match[str]) -> str:
    return f"img_backbone.stage{int(match[1]) + 2}.{_block(match)}"
