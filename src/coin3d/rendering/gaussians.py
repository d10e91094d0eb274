"""A scene as isotropic, opaque 3D Gaussians: where, how large, which colour."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int, UInt8


@dataclass(frozen=True, eq=False)
class Gaussians:
    """N Gaussians with covariance ``std_m**2`` times the identity and opacity 1, in the ego frame.

    Any order is correct, also for the picture (equal depths are composited by row). Rows that are neighbours in space should
    be neighbours in the table: the renderer skips blocks of 256 consecutive rows that a camera cannot see.

    Args:
        centre_m: (N, 3) float32, metres in the ego frame.
        std_m: (N,) float32 standard deviations in metres.
        rgb: (N, 3) uint8 colours.

    Raises:
        ValueError: another shape or type, a number that is not finite, a standard deviation that is not positive.
    """

    centre_m: Float32[np.ndarray, "n 3"]
    std_m: Float32[np.ndarray, "n"]
    rgb: UInt8[np.ndarray, "n 3"]

    def __post_init__(self) -> None:
        n = len(self.centre_m)
        for name, dtype, shape in (("centre_m", np.float32, (n, 3)), ("std_m", np.float32, (n,)), ("rgb", np.uint8, (n, 3))):
            value = getattr(self, name)
            if value.dtype != dtype or value.shape != shape:
                raise ValueError(
                    f"{name} of {n} Gaussians is {np.dtype(dtype).name} of shape {shape}, got {value.dtype} {value.shape}"
                )
            view = np.ascontiguousarray(value).view()
            view.setflags(write=False)
            object.__setattr__(self, name, view)
        if not n:
            return
        # minimum and maximum carry a NaN through and need no temporary of the size of the scene
        if not (np.isfinite(self.centre_m.min()) and np.isfinite(self.centre_m.max())):
            row = int(np.argmax(~np.isfinite(self.centre_m).all(1)))
            raise ValueError(f"Gaussian {row} has the centre {self.centre_m[row].tolist()}: centres are finite metres")
        if not (self.std_m.min() > 0 and np.isfinite(self.std_m.max())):
            row = int(np.argmax(~((self.std_m > 0) & np.isfinite(self.std_m))))
            raise ValueError(f"Gaussian {row} has the standard deviation {self.std_m[row]:g} m: it must be positive and finite")

    @classmethod
    def empty(cls) -> Gaussians:
        """No Gaussians at all."""
        return cls(np.zeros((0, 3), np.float32), np.zeros(0, np.float32), np.zeros((0, 3), np.uint8))

    @classmethod
    def concatenate(cls, parts: Iterable[Gaussians]) -> Gaussians:
        """All rows of several scenes, in order."""
        parts = [*parts]
        if not parts:
            return cls.empty()
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("centre_m", "std_m", "rgb")))

    def __len__(self) -> int:
        return len(self.centre_m)

    def __getitem__(self, rows: slice | Bool[np.ndarray, "n"] | Int[np.ndarray, "m"]) -> Gaussians:
        """Some rows, by slice, mask or index array."""
        return Gaussians(self.centre_m[rows], self.std_m[rows], self.rgb[rows])
