"""A box of space as the unit cube, and the logits in which networks shift places within it."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

_NEAR_ZERO = 1e-5


@dataclass(frozen=True)
class SpaceRange:
    """A box of space in which coordinates run from 0 to 1.

    Args:
        low_m: smallest x, y, z.
        high_m: largest x, y, z.

    Raises:
        ValueError: a side that is not positive.
    """

    low_m: tuple[float, float, float]
    high_m: tuple[float, float, float]

    def __post_init__(self) -> None:
        if any(low >= high for low, high in zip(self.low_m, self.high_m, strict=True)):
            raise ValueError(f"a range of space rises along x, y and z, got {self.low_m} to {self.high_m}")

    def normalise(self, points_m: Float[Tensor, "... 3"]) -> Float[Tensor, "... 3"]:
        """Metres to 0..1 (beyond it outside the range)."""
        low, high = points_m.new_tensor(self.low_m), points_m.new_tensor(self.high_m)
        return (points_m - low) / (high - low)

    def metres(self, unit: Float[Tensor, "... 3"]) -> Float[Tensor, "... 3"]:
        """0..1 to metres."""
        low, high = unit.new_tensor(self.low_m), unit.new_tensor(self.high_m)
        return unit * (high - low) + low


def inverse_sigmoid(unit: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """Logit of a number in 0..1; beyond, that of the nearest number which still has one."""
    unit = unit.clamp(0, 1)
    return (unit.clamp(min=_NEAR_ZERO) / (1 - unit).clamp(min=_NEAR_ZERO)).log()
