"""Building what a file describes, without taking memory that the file's own weights do not call for."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any, TypeVar

import torch
from torch.utils._python_dispatch import TorchDispatchMode

T = TypeVar("T")

_TIMES = 4
_SPARE = 2**26
"""Tables and random numbers that are made while a network is built, in numbers."""
_TENSORS_TIMES, _TENSORS_SPARE = 20, 2000
"""How many tensors may be made per tensor of the file: networks of endless tiny layers are none either."""

_MAKERS = ("empty", "zeros", "ones", "full", "rand", "randn", "new_empty", "new_zeros", "new_ones", "new_full")
_RANGES = ("arange", "linspace", "eye")


class _Budget(TorchDispatchMode):  # type: ignore[no-untyped-call]
    """Counts new tensors and the numbers in them before they are made."""

    def __init__(self, numbers: int, tensors: int) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self._left, self._tensors_left = numbers, tensors

    def __torch_dispatch__(
        self, func: Any, types: Any, args: tuple[Any, ...] = (), kwargs: Mapping[str, Any] | None = None
    ) -> Any:
        name = func.overloadpacket.__name__
        if name in _MAKERS:
            self._take(next((arg for arg in args if isinstance(arg, list | tuple)), ()))
        elif name in _RANGES:
            self._take([max((abs(arg) for arg in args if isinstance(arg, int | float)), default=0)])
        return func(*args, **(kwargs or {}))

    def _take(self, sides: Iterable[float]) -> None:
        numbers = 1
        for side in sides:
            numbers *= max(0, int(side))
        self._left -= numbers
        self._tensors_left -= 1
        if self._left < 0 or self._tensors_left < 0:
            raise ValueError("the description asks for a far larger network than the weights are of")


def build_within(build: Callable[[], T], shapes: Collection[Sequence[int]], where: str) -> T:
    """What ``build`` makes, a network that a file describes.

    Args:
        build: makes it.
        shapes: of the weights in the file.
        where: names the file.

    Raises:
        ValueError: it would take far more memory than its weights, or nothing can be built from the description.
    """
    numbers = sum(int(torch.Size(shape).numel()) for shape in shapes)
    try:
        with _Budget(_TIMES * numbers + _SPARE, _TENSORS_TIMES * len(shapes) + _TENSORS_SPARE):
            return build()
    # any number of the description may be one that some layer cannot be made of
    except (
        ValueError, TypeError, KeyError, IndexError, AttributeError, RuntimeError, AssertionError, ArithmeticError, MemoryError,
    ) as error:  # fmt: skip
        message = str(error).partition("\n")[0]
        raise ValueError(f"{where}: no detector can be built from the description in the checkpoint ({message})") from error
