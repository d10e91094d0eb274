"""Colours of what objects hide (spec official_code 4, step 3.5). A learned model plugs in as any ``Inpainting``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import cv2
import numpy as np
from jaxtyping import Bool, UInt8


@runtime_checkable
class Inpainting(Protocol):
    """From an image and a mask to an image without what the mask covers."""

    def __call__(self, rgb: UInt8[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
        """The image with new colours under the mask; other pixels are not looked at."""
        ...


@dataclass(frozen=True)
class FastMarchingInpainting:
    """Colours marched inwards from the rim (Telea 2004): right for streets and walls, smooth inside large objects.

    Args:
        radius_px: how far around a pixel colours are gathered.
        max_width_px: wider images are inpainted at this width; inside large masks there is no detail to lose.
    """

    radius_px: float = 3.0
    max_width_px: int = 400

    def __call__(self, rgb: UInt8[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
        if not mask.any() or mask.all():
            return rgb
        height, width = mask.shape
        small = (min(width, self.max_width_px), round(height * min(width, self.max_width_px) / width))
        covered = cv2.resize(mask.astype(np.float32), small, interpolation=cv2.INTER_AREA) > 0
        # one pixel more: shrinking mixes colours of the object into the rim
        grown = cv2.dilate(covered.astype(np.uint8), np.ones((3, 3), dtype=np.uint8))
        shrunk = cv2.resize(rgb, small, interpolation=cv2.INTER_AREA)
        filled = cv2.inpaint(shrunk, grown, self.radius_px, cv2.INPAINT_TELEA)
        enlarged = cv2.resize(filled, (width, height), interpolation=cv2.INTER_LINEAR)
        return np.where(mask[..., None], enlarged, rgb).astype(np.uint8)
