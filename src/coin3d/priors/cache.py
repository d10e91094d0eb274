"""Prior maps are functions of the rig alone: compute them once per rig."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable

from jaxtyping import Float
from torch import Tensor

from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.priors.maps import downsample, prior_maps


class PriorCache:
    """Maps of the cameras seen last, at full resolution and at feature strides; a hit returns the same tensors.

    Args:
        compute: cameras -> maps at image resolution; bind ``PriorOptions`` or released conventions into it.
        capacity: how many different camera batches are kept. Random augmentation never hits, so this stays small.
    """

    def __init__(self, compute: Callable[[CameraTensors], Float[Tensor, "m 9 h w"]] = prior_maps, capacity: int = 4) -> None:
        if capacity < 1:
            raise ValueError(f"a prior cache holds at least one rig, got capacity {capacity}")
        self._compute = compute
        self._capacity = capacity
        self._by_rig: OrderedDict[tuple[object, ...], dict[int, Tensor]] = OrderedDict()

    def maps(self, cameras: CameraTensors, stride: int = 1) -> Float[Tensor, "m 9 h2 w2"]:
        """The prior maps averaged to ``stride``. Do not write into them: the next caller gets the same tensor."""
        key = cameras.key
        levels = self._by_rig.pop(key, None)
        if levels is None:
            levels = {1: self._compute(cameras)}
        self._by_rig[key] = levels
        while len(self._by_rig) > self._capacity:
            self._by_rig.popitem(last=False)
        if stride not in levels:
            levels[stride] = downsample(levels[1], stride)
        return levels[stride]

    def __len__(self) -> int:
        return len(self._by_rig)

    def clear(self) -> None:
        self._by_rig.clear()
