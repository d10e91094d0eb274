"""Every key of the released BEVFormer-tiny is loaded or left out for a reason; files that do not fit are refused by name."""

from __future__ import annotations

import pytest
import torch
from bevformer_released import CLASSES, CONFIG, released_shapes
from torch import Tensor

from coin3d.detectors import Method
from coin3d.detectors.bevformer import BEVFormer
from coin3d.training.released.bevformer_keys import LEFT_OUT, bevformer_name, bevformer_weights, box_rows


@pytest.fixture(scope="module")
def expected() -> dict[str, Tensor]:
    with torch.device("meta"):
        return BEVFormer(CONFIG, CLASSES, Method()).state_dict()


@pytest.fixture
def released() -> dict[str, Tensor]:
    return {key: torch.empty(shape, device="meta") for key, shape in released_shapes().items()}


def test_every_key_has_one_place(released: dict[str, Tensor], expected: dict[str, Tensor]) -> None:
    names = [bevformer_name(key) for key in released if key not in LEFT_OUT]
    assert len(released) == 643 and len(names) == 642
    assert sorted(map(str, names)) == sorted(expected)
    assert set(bevformer_weights(released, expected)) == set(expected)


def test_missing_key_is_named(released: dict[str, Tensor], expected: dict[str, Tensor]) -> None:
    del released["pts_bbox_head.transformer.cams_embeds"]
    with pytest.raises(ValueError, match=r"released\.camera_embedding.*1 are missing"):
        bevformer_weights(released, expected)


@pytest.mark.parametrize("extra", ["pts_bbox_head.anchors", "pts_bbox_head.cls_branches.6.0.weight", "teacher.conv1.weight"])
def test_extra_key_is_named(extra: str, released: dict[str, Tensor], expected: dict[str, Tensor]) -> None:
    with pytest.raises(ValueError, match=f"'{extra}' is no weight of BEVFormer-tiny"):
        bevformer_weights({**released, extra: torch.zeros(1)}, expected)


def test_misshapen_key_is_named(released: dict[str, Tensor], expected: dict[str, Tensor]) -> None:
    key = "pts_bbox_head.bev_embedding.weight"
    with pytest.raises(ValueError, match=rf"'{key}' has shape \(40000, 256\).* needs \(2500, 256\)"):
        bevformer_weights({**released, key: torch.empty(40000, 256, device="meta")}, expected)


def test_box_rows_turn_the_coding() -> None:
    """A box 4 m long and 2 m wide with heading 0.3, as the released coding writes it."""
    log, yaw = torch.tensor([2.0, 4.0]).log(), torch.tensor(-0.3 - torch.pi / 2)
    rows = torch.tensor([1, 2, log[0], log[1], 3, 4, yaw.sin(), yaw.cos(), 5, 6])
    heading = torch.tensor(0.3)
    torch.testing.assert_close(box_rows(rows), torch.tensor([1, 2, log[1], log[0], 3, 4, heading.sin(), heading.cos(), 5, 6]))
