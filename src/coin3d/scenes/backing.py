"""A band of far surface continued behind every near edge, so that a camera that moves sideways does not look into a gap.

Objects have the background that they hide (``revealed``); this is the same for everything else: roofs before the sky,
poles before walls, kerbs before pavements.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, UInt8

from coin3d.scenes.back_layer import BackLayer

_STEP = 1.15  # a surface that much farther than its neighbour pixel is another one
_MIN_GAP_M = 0.3


def continue_behind(depth_m: Float[np.ndarray, "h w"], rgb: UInt8[np.ndarray, "h w 3"], band_px: int) -> BackLayer:
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
    for _ in range(band_px):
        before_m, before_rgb, before = back_m.copy(), back_rgb.copy(), mask.copy()
        for to, source in _NEIGHBOURS:
            # a neighbour hands on its second layer if it has one, else what is seen there
            takes = ~mask[to] & (before_m[source] > limit_m[to])
            back_m[to] = np.where(takes, before_m[source], back_m[to])
            back_rgb[to] = np.where(takes[..., None], before_rgb[source], back_rgb[to])
            mask[to] |= takes
        if np.array_equal(mask, before):
            break
    return BackLayer(mask, back_m, back_rgb)


_ALL = slice(None)
_NEIGHBOURS = (
    ((_ALL, slice(1, None)), (_ALL, slice(None, -1))),
    ((_ALL, slice(None, -1)), (_ALL, slice(1, None))),
    ((slice(1, None),), (slice(None, -1),)),
    ((slice(None, -1),), (slice(1, None),)),
)
