"""The ground plane a rig stands on."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float


def _up() -> Float[np.ndarray, "3"]:
    return np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class GroundPlane:
    """Points p of the ego frame with ``normal . p + offset_m = 0``; the default is z = 0.

    Args:
        normal: (3,) unit vector pointing up, out of the ground.
        offset_m: signed distance; -0.3 puts the plane 0.3 m above the ego origin.

    Raises:
        ValueError: a normal without length, not finite, or pointing down.
    """

    normal: Float[np.ndarray, "3"] = field(default_factory=_up)
    offset_m: float = 0.0

    def __post_init__(self) -> None:
        normal = np.array(self.normal, dtype=np.float64)
        if normal.shape != (3,) or not np.isfinite(normal).all() or not np.isfinite(self.offset_m):
            raise ValueError(f"a ground plane needs a finite (3,) normal and offset, got {self.normal}, {self.offset_m}")
        length = float(np.linalg.norm(normal))
        if length < 1e-9 or normal[2] <= 0:
            raise ValueError(f"the normal of the ground must point up (z > 0), got {normal.tolist()}")
        normal = normal / length
        normal.setflags(write=False)
        object.__setattr__(self, "normal", normal)
        object.__setattr__(self, "offset_m", float(self.offset_m) / length)

    def height_m(self, points_ego: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "..."]:
        """Signed height of points above the plane."""
        height: np.ndarray = np.asarray(np.asarray(points_ego, dtype=np.float64) @ self.normal + self.offset_m)
        return height

    @property
    def is_default(self) -> bool:
        return bool(np.array_equal(self.normal, [0, 0, 1])) and self.offset_m == 0.0
