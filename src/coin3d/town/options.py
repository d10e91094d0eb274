"""What may be chosen about a town; everything else follows from the seed."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class TownOptions:
    """Options of a town. The same seed and options always give the same world, whatever rig looks at it.

    Args:
        slope: hilly ground instead of a flat one.
        traffic: factor on the number of parked and moving vehicles; 1 is a busy street.
        people: factor on the number of pedestrians and riders.
        duration_s: how long the traffic is planned; a recording must end before it.

    Raises:
        ValueError: a factor that is negative or a duration that is not positive.
    """

    slope: bool = False
    traffic: float = 1.0
    people: float = 1.0
    duration_s: float = 12.0

    def __post_init__(self) -> None:
        if self.traffic < 0 or self.people < 0:
            raise ValueError(f"traffic and people are factors of 0 or more, got {self.traffic} and {self.people}")
        if not 0 < self.duration_s <= 60:
            raise ValueError(f"duration_s is between 0 and 60 s, got {self.duration_s}")

    def to_dict(self) -> dict[str, Any]:
        """Plain values for ``town.json``."""
        return asdict(self)
