"""Every name of Megvii's released weights has a place or a reason; a file that does not fit is named."""

from __future__ import annotations

import pytest
import torch
from megvii_released import VARIANTS, released_shapes
from torch import Tensor

from coin3d.detectors import BEVDepth, BEVDepthConfig
from coin3d.methods import Direct
from coin3d.training.released.megvii_keys import MEGVII_KEYS, megvii_options

RELEASED_COUNTS = {"2key": 861, "2key_da": 881}
BUFFERS = ["frustum", "voxel_coord", "voxel_num", "voxel_size"]


def checkpoint(variant: str) -> dict[str, Tensor]:
    """Names and shapes without values."""
    return {name: torch.empty(shape, device="meta") for name, shape in released_shapes(*VARIANTS[variant]).items()}


def own_state(variant: str) -> dict[str, Tensor]:
    config = BEVDepthConfig.released_megvii(*VARIANTS[variant])
    assert config.megvii is not None
    with torch.device("meta"):
        state: dict[str, Tensor] = BEVDepth(config, config.megvii.classes, Direct(megvii_options())).state_dict()
    return state


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_weight_has_a_place(variant: str) -> None:
    released, own = checkpoint(variant), own_state(variant)
    assert len(released) == RELEASED_COUNTS.get(variant, 861)
    assert set(MEGVII_KEYS.convert(released, own)) == set(own)
    left_out = {name: MEGVII_KEYS.reason(name) for name in released if MEGVII_KEYS.name(name) is None}
    assert sorted(name.removeprefix("model.backbone.") for name in left_out) == BUFFERS
    assert all(left_out.values())
    taken = [MEGVII_KEYS.name(name) for name in released if name not in left_out]
    assert len(taken) == len(set(taken)) == len(own)


def test_names_without_the_field_of_the_training_framework() -> None:
    released = {name.removeprefix("model."): tensor for name, tensor in checkpoint("2key_da").items()}
    own = own_state("2key_da")
    assert set(MEGVII_KEYS.convert(released, own)) == set(own)


def test_what_does_not_fit_is_named() -> None:
    released, own = checkpoint("2key_da"), own_state("2key_da")
    weight = "model.backbone.depth_net.depth_conv.4.weight"
    missing = {name: tensor for name, tensor in released.items() if name != weight}
    with pytest.raises(ValueError, match=r"lacks the weight for 'depth_net\.depth_conv\.4\.weight'"):
        MEGVII_KEYS.convert(missing, own)
    with pytest.raises(ValueError, match=r"depth_conv\.4\.weight' .* shape \(512, 512, 3, 3\), this detector needs \(512, 128"):
        MEGVII_KEYS.convert({**released, weight: torch.empty(512, 512, 3, 3, device="meta")}, own)
    with pytest.raises(ValueError, match=r"'model\.head\.other' is no weight of Megvii's"):
        MEGVII_KEYS.convert({**released, "model.head.other": torch.empty(1)}, own)
    with pytest.raises(ValueError, match=r"task_heads\.6\.reg\.1\.bias' .* which this detector does not have"):
        MEGVII_KEYS.convert({**released, "model.head.task_heads.6.reg.1.bias": torch.empty(2)}, own)
    # a file with depth aggregation does not go into a detector without
    with pytest.raises(ValueError, match=r"'aggregation\.reduce\.0\.weight', which this detector does not have"):
        MEGVII_KEYS.convert(released, own_state("2key"))
