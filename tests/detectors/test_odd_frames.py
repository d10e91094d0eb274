"""What recordings hold now and then: every detector trains through it and stays finite."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch

from coin3d.detectors import TRAINABLE, Detector, Sample, collate
from coin3d.detectors.method import Method
from coin3d.geometry import Boxes3D
from small_world import CLASSES, CONFIG, SIZE_PX, ring_rig, sample


def fresh(name: str) -> Detector:
    config_type, make = TRAINABLE[name]
    config = CONFIG if name == "bevdepth" else config_type.of(CONFIG) if name == "trunk" else config_type.tiny()
    torch.manual_seed(0)
    return make(replace(config, image_width_px=SIZE_PX[0], image_height_px=SIZE_PX[1]), CLASSES, Method())


def far_boxes() -> Boxes3D:
    """Beyond every grid, above every range, and one with a yaw and a velocity that nobody knows."""
    centre, size = [(400.0, 3.0, 1.0), (5.0, 0.0, 300.0), (6.0, 1.0, 1.0)], [(4.0, 2.0, 1.5)] * 3
    return Boxes3D.create(centre, size, [0.0, 1.0, 2.0], ["car"] * 3, velocity_mps=[(0, 0), (1, 1), (np.nan, np.nan)])


def nan_depth(one: Sample) -> Sample:
    assert one.depth_m is not None
    depth_m = one.depth_m.copy()
    depth_m[:, ::2] = np.nan
    return replace(one, depth_m=depth_m)


ODD = {
    "NaN depth": nan_depth,
    "no depth at all": lambda one: replace(one, depth_m=np.zeros_like(one.depth_m)),
    "no boxes": partial(replace, boxes=Boxes3D.empty()),
    "boxes out of range": partial(replace, boxes=far_boxes()),
}


@pytest.mark.parametrize("name", TRAINABLE)
@pytest.mark.parametrize("odd", ODD)
def test_training_stays_finite(name: str, odd: str) -> None:
    model = fresh(name)
    batch = collate([ODD[odd](sample(0, ring_rig(2))), ODD[odd](sample(1, ring_rig(3)))])
    optimizer = torch.optim.SGD(model.parameters(), 1e-3)
    for _ in range(2):
        total = torch.stack(list(model.losses(batch).values())).sum()
        assert torch.isfinite(total)
        optimizer.zero_grad()
        total.backward()
        assert all(torch.isfinite(p.grad).all() for p in model.parameters() if p.grad is not None)
        optimizer.step()
    assert all(torch.isfinite(p).all() for p in model.parameters())
