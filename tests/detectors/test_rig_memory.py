"""Per-rig results: computed once, again for anything that matters, and never from weights of yesterday."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import nn

from coin3d.detectors import DETECTORS, collate
from coin3d.detectors.method import Method
from coin3d.detectors.rig_memory import RigMemory
from small_world import CLASSES, batch, ring_rig, sample


class Counter:
    calls = 0

    def __call__(self) -> int:
        self.calls += 1
        return self.calls


def test_a_rig_is_computed_once() -> None:
    memory, compute = RigMemory[int](), Counter()
    one, other_images = batch(sample(0, ring_rig(2))), batch(sample(1, ring_rig(2)))
    assert memory.get(one, compute) == memory.get(other_images, compute) == 1
    different = [
        batch(sample(0, ring_rig(3))),
        batch(sample(0, ring_rig(2, focal_px=61.0))),
        batch(sample(0, ring_rig(2), bev_from_ego=np.diag([-1.0, 1.0, 1.0]))),
        collate([sample(0, ring_rig(1)), sample(0, ring_rig(1))]),
    ]
    for number, changed in enumerate(different, start=2):
        assert memory.get(changed, compute) == number
    with torch.autocast("cpu", dtype=torch.bfloat16):
        assert memory.get(one, compute) == 6


def test_only_the_latest_rigs_are_kept() -> None:
    memory, compute = RigMemory[int](capacity=2), Counter()
    a, b, c = (batch(sample(0, ring_rig(n))) for n in (1, 2, 3))
    for one in (a, b, a, c):  # b was seen longest ago
        memory.get(one, compute)
    assert compute.calls == 3
    assert memory.get(a, compute) == 1 and memory.get(b, compute) == 4


def test_changed_weights_are_noticed() -> None:
    memory, compute, layer = RigMemory[int](), Counter(), nn.Linear(2, 2)
    one = batch(sample(0, ring_rig(1)))
    weights = list(layer.parameters())
    memory.get(one, compute, weights)
    with torch.no_grad():
        layer.bias.add_(1.0)
    assert memory.get(one, compute, weights) == 2
    layer.load_state_dict(layer.state_dict())
    assert memory.get(one, compute, weights) == 3
    assert memory.get(one, compute, weights) == 3


def test_detectors_give_the_same_with_memory_and_without() -> None:
    both = collate([sample(0, ring_rig(5)), sample(1, ring_rig(6, focal_px=80.0))])
    for kind, make in DETECTORS.values():
        config = replace(kind.tiny(), image_width_px=96, image_height_px=64)
        torch.manual_seed(0)
        model = make(config, CLASSES, Method()).eval()
        expected = {name: value.detach() for name, value in model(both).items()}  # with gradients: nothing remembered
        for _ in range(2):
            with torch.no_grad():
                found = model(both)
            for name, value in expected.items():
                torch.testing.assert_close(found[name], value, rtol=1e-5, atol=1e-5)
