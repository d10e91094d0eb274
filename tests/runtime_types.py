"""The checker of annotations that tests/conftest.py hangs onto every function of coin3d."""

from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
from beartype import BeartypeConf, FrozenDict, beartype
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

_PROJECTOR = Literal["conv1", "conv1+conv1", "conv3", "conv3+conv3"]
# Arrays are what is checked here; mypy checks the rest. numpy's own whole numbers are no int, rows of its object arrays no
# Sequence, and its ArrayLike is a protocol that tuples do not meet, though numpy takes all of them. A wrong name of a
# projector has a test of its own.
_LENIENT = FrozenDict(
    {int: int | np.integer, float: float | int | np.number, ArrayLike: object, Sequence[Axes]: object, _PROJECTOR: str}
)
_beartype = beartype(conf=BeartypeConf(hint_overrides=_LENIENT))


def check(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function with its annotations checked; records validate themselves, with better messages, and are left alone."""
    return function if function.__name__ == "__init__" else _beartype(function)
