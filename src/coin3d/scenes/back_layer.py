"""A second layer behind an image: what a camera that moves looks at where near things leave its way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8


@dataclass(frozen=True, eq=False)
class BackLayer:
    """Depth and colours behind some pixels of an image.

    Args:
        mask: (h, w) pixels that have something behind them.
        depth_m: (h, w) its depth along the optical axis.
        rgb: (h, w, 3) its colours.
    """

    mask: Bool[np.ndarray, "h w"]
    depth_m: Float[np.ndarray, "h w"]
    rgb: UInt8[np.ndarray, "h w 3"]
