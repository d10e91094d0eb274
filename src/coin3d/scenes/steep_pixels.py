"""Pixels between two surfaces: depth that slides from one to the other would fly as dust between them."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float

_STEEP = 0.1  # share of inverse depth per pixel, at 400 pixels width
_REACH_M = 45.0
_HALF_WINDOW_SHARE = 1 / 80  # of the width


def snap_steep(depth_m: Float[np.ndarray, "h w"], free: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """Depth whose slides between two surfaces are steps.

    Where inverse depth changes by more than a tenth per pixel (at 400 pixels width) no surface within 45 m is that
    slanted, so the pixel belongs to one of the two sides: it takes the depth of the nearer side in inverse depth.

    Args:
        depth_m: (h, w) positive.
        free: pixels that may be changed: completed ones, not those measured.
    """
    inverse = (1 / depth_m).astype(np.float32)
    limit = np.float32(_STEEP * 400 / depth_m.shape[1])
    slope = np.maximum(np.abs(_central(inverse, 0)), np.abs(_central(inverse, 1)))
    steep = free & (slope > limit * inverse) & (depth_m < _REACH_M)
    if not steep.any():
        return depth_m
    side = 2 * max(3, round(depth_m.shape[1] * _HALF_WINDOW_SHARE)) + 1
    window = np.ones((side, side), dtype=np.uint8)
    # steep pixels do not vote
    near = cv2.dilate(np.where(steep, np.float32(0), inverse), window, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    far = cv2.erode(np.where(steep, np.float32(1e9), inverse), window, borderType=cv2.BORDER_CONSTANT, borderValue=1e9)
    voted = steep & (near > 0) & (far < 1e9)
    snapped = np.where(near - inverse < inverse - far, near, far)
    return np.where(voted, 1 / np.where(voted, snapped, 1), depth_m).astype(np.float32)


def _central(values: Float[np.ndarray, "h w"], axis: int) -> Float[np.ndarray, "h w"]:
    """Change per pixel along an axis: the larger of the steps to both neighbours."""
    step = np.abs(np.diff(values, axis=axis))
    pad = [(1, 1) if a == axis else (0, 0) for a in range(2)]
    padded = np.pad(step, pad)
    before, after = np.take(padded, range(values.shape[axis]), axis), np.take(padded, range(1, values.shape[axis] + 1), axis)
    return np.asarray(np.maximum(before, after))
