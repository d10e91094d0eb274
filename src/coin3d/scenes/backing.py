"""A band of far surface continued behind every near edge, so that a camera that moves sideways does not look into a gap.

Objects have the background that they hide (``revealed``); this is the same for everything else: roofs before the sky,
poles before walls, kerbs before pavements.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8

from coin3d.scenes.back_layer import BackLayer

_STEP = 1.15  # a surface that much farther than its neighbour pixel is another one
_MIN_GAP_M = 0.3


@dataclass(frozen=True, eq=False)
class Band(BackLayer):
    """A layer that ends a little behind the edges.

    Args:
        distance_px: (h, w) how many steps to a neighbour lead to the edge, where there is a layer.
    """

    distance_px: Int[np.ndarray, "h w"]


def continue_behind(depth_m: Float[np.ndarray, "h w"], rgb: UInt8[np.ndarray, "h w 3"], band_px: int) -> Band:
    """Continue far surfaces at their depth for up to ``band_px`` pixels behind nearer ones.

    A pixel takes depth and colour of the nearest place (in pixels) where the image steps to something at least 15 % and
    0.3 m farther than the pixel itself.

    Args:
        depth_m: (h, w) positive depth.
        rgb: (h, w, 3).
        band_px: width of the band.
    """
    back_m, back_rgb = depth_m.copy(), rgb.copy()
    mask = np.zeros(depth_m.shape, dtype=bool)
    limit_m = np.maximum(depth_m * np.float32(_STEP), depth_m + np.float32(_MIN_GAP_M))
    distance = np.zeros(depth_m.shape, dtype=np.int32)
    for step in range(1, band_px + 1):
        before_m, before_rgb, before = back_m.copy(), back_rgb.copy(), mask.copy()
        for to, source in _NEIGHBOURS:
            # a neighbour hands on its second layer if it has one, else what is seen there
            takes = ~mask[to] & (before_m[source] > limit_m[to])
            back_m[to] = np.where(takes, before_m[source], back_m[to])
            back_rgb[to] = np.where(takes[..., None], before_rgb[source], back_rgb[to])
            mask[to] |= takes
        new = mask & ~before
        if not new.any():
            break
        distance[new] = step
    return Band(mask, back_m, back_rgb, distance)


_ALL = slice(None)
_NEIGHBOURS = (
    ((_ALL, slice(1, None)), (_ALL, slice(None, -1))),
    ((_ALL, slice(None, -1)), (_ALL, slice(1, None))),
    ((slice(1, None),), (slice(None, -1),)),
    ((slice(None, -1),), (slice(1, None),)),
)
