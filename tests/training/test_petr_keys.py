"""Names, shapes and rearranged rows of released PETR weights; no network is run and no weight file needed."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from coin3d.detectors.petr import PETR, PETRConfig
from coin3d.methods import Method
from coin3d.training.released.petr_keys import box_rows, convert_petr, left_out, released_name

STEM = "img_backbone.stem.stem_1/conv.weight"
SINE = "pts_bbox_head.adapt_pos3d.0.weight"
LAST_BOX_LAYER = "pts_bbox_head.reg_branches.0.4."


@pytest.fixture(scope="module")
def expected() -> dict[str, Tensor]:
    """Names and shapes of the detector the weights are for, without their numbers."""
    with torch.device("meta"):
        return PETR(PETRConfig.released_nuscenes(), tuple(f"class{i}" for i in range(10)), Method()).state_dict()


@pytest.fixture(scope="module")
def complete(expected: dict[str, Tensor]) -> dict[str, Tensor]:
    """A released file of ones, and numbers that tell rows and channels apart where they move."""
    weights = {released_name(n): torch.ones(()).to(t.dtype).expand(t.shape) for n, t in expected.items()}
    weights[STEM] = torch.arange(3.0)[None, :, None, None].expand(64, 3, 3, 3)
    weights[SINE] = torch.arange(384.0)[None, :, None, None].expand(1024, 384, 1, 1)
    weights[LAST_BOX_LAYER + "weight"] = torch.arange(1.0, 11)[:, None].expand(10, 256)
    weights[LAST_BOX_LAYER + "bias"] = torch.arange(1.0, 11)
    shared = [n for n in weights if "_branches.0." in n]
    copies = {n.replace(".0.", f".{layer}.", 1): weights[n] for n in shared for layer in range(1, 6)}
    return {**weights, **copies, "pts_bbox_head.code_weights": torch.ones(10)}


def test_every_weight_arrives(complete: dict[str, Tensor], expected: dict[str, Tensor]) -> None:
    converted = convert_petr(complete, expected)
    assert {n: t.shape for n, t in converted.items()} == {n: t.shape for n, t in expected.items()}
    assert {n: t.dtype for n, t in converted.items()} == {n: t.dtype for n, t in expected.items()}
    used = {released_name(name) for name in expected}
    reasons = [left_out(name) for name in complete.keys() - used]
    assert len(reasons) == 5 * 16 + 1 and None not in reasons


def test_what_moves(complete: dict[str, Tensor], expected: dict[str, Tensor]) -> None:
    """Blue comes last, length before width, the yaw turns the other way from another axis, sines and cosines alternate."""
    converted = convert_petr(complete, expected)
    assert converted["backbone.stem.0.0.weight"][0, :, 0, 0].tolist() == [2, 1, 0]
    wanted = [1, 2, 4, 3, 5, 6, -8, -7, 9, 10]
    assert converted["box_branch.4.bias"].tolist() == wanted
    assert converted["box_branch.4.weight"][:, 17].tolist() == wanted
    sine = converted["camera_sine.mlp.0.weight"][5, :, 0, 0].tolist()
    assert sine[:4] == [0, 64, 1, 65] and sine[126:130] == [63, 127, 128, 192]
    port = convert_petr(complete, expected, "mmdet3d")
    assert port["box_branch.4.bias"].tolist() == [1, 2, 3, 4, 5, 6, -8, -7, 9, 10]


def test_yaw_of_a_box_that_faces_forward() -> None:
    """In the LiDAR frame forward is +y: a yaw of pi/2, which the released code writes as -pi."""
    released = torch.zeros(10)
    released[6:8] = torch.tensor([0.0, -1.0])  # sine and cosine of -pi
    rows, signs = box_rows("authors")
    sine, cosine = (released[rows] * torch.tensor(signs))[6:8].tolist()
    assert (sine, cosine) == (1.0, 0.0)


def test_files_that_do_not_fit_are_refused_by_name(complete: dict[str, Tensor], expected: dict[str, Tensor]) -> None:
    with pytest.raises(ValueError, match=r"lacks 'img_backbone\.stem\.stem_1/conv\.weight' \(1 weights"):
        convert_petr({n: t for n, t in complete.items() if n != STEM}, expected)
    with pytest.raises(ValueError, match=r"has 'pts_bbox_head\.extra'"):
        convert_petr({**complete, "pts_bbox_head.extra": torch.ones(1)}, expected)
    with pytest.raises(ValueError, match=r"'img_backbone\.stem\.stem_1/conv\.weight' has the shape \(64, 4, 3, 3\)"):
        convert_petr({**complete, STEM: torch.ones(64, 4, 3, 3)}, expected)
    copy = "pts_bbox_head.cls_branches.3.6.bias"
    with pytest.raises(ValueError, match=r"'pts_bbox_head\.cls_branches\.3\.6\.bias' differs"):
        convert_petr({**complete, copy: torch.zeros(10)}, expected)


def test_detectors_with_other_parts_have_no_released_weights() -> None:
    with pytest.raises(ValueError, match=r"'perspective\.output\.bias' is no weight"):
        released_name("perspective.output.bias")
