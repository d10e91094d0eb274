"""What depends on the rig alone is computed once per rig."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable
from typing import Generic, TypeVar

import torch
from torch import Tensor

from coin3d.detectors.batch import Batch

Value = TypeVar("Value")


class RigMemory(Generic[Value]):
    """The results of the rigs seen last.

    For evaluation: random augmentation never sees a rig twice, so ask only where nothing is trained.

    Args:
        capacity: how many rigs (batches of cameras) are kept.
    """

    def __init__(self, capacity: int = 4) -> None:
        self.capacity = capacity
        self._values: OrderedDict[tuple[object, ...], Value] = OrderedDict()

    def get(self, batch: Batch, compute: Callable[[], Value], weights: Iterable[Tensor] = ()) -> Value:
        """The value of the batch's cameras, computed if need be.

        Args:
            batch: whose cameras, samples and BEV augmentation matter, not its images.
            compute: makes the value.
            weights: that enter it; where they have changed since, it is made anew.
        """
        tensors = (batch.sample_index, batch.bev_from_ego)
        numbers = tuple(t.detach().cpu().numpy().tobytes() for t in tensors)
        half = torch.is_autocast_enabled(batch.images.device.type)
        key = (batch.cameras.key, numbers, half, tuple((w.data_ptr(), w._version) for w in weights))
        if key not in self._values:
            self._values[key] = compute()
            while len(self._values) > self.capacity:
                self._values.popitem(last=False)
        self._values.move_to_end(key)
        return self._values[key]
