"""Readable text on any background."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import UInt8

from coin3d.drawing.colours import BACKGROUND, RGB, TEXT

_FONT = cv2.FONT_HERSHEY_SIMPLEX
_CAP_HEIGHT = 22.0  # pixels of a capital at scale 1


def text_size(text: str, height_px: float) -> tuple[int, int]:
    """Width and height in pixels of a line whose capitals are ``height_px`` high."""
    (width, height), _ = cv2.getTextSize(text, _FONT, height_px / _CAP_HEIGHT, _thickness(height_px))
    return width, height


def put_text(
    image: UInt8[np.ndarray, "h w 3"],
    text: str,
    left: float,
    baseline: float,
    height_px: float = 12.0,
    colour: RGB = TEXT,
    outlined: bool = True,
) -> None:
    """Write a line into ``image`` (changed in place), with a dark outline where the background is a picture."""
    where, scale, thickness = (round(left), round(baseline)), height_px / _CAP_HEIGHT, _thickness(height_px)
    if outlined:
        cv2.putText(image, text, where, _FONT, scale, BACKGROUND, thickness + 2, cv2.LINE_AA)
    cv2.putText(image, text, where, _FONT, scale, colour, thickness, cv2.LINE_AA)


def shortened(text: str, height_px: float, width_px: float) -> str:
    """The text, cut with dots so that it fits into ``width_px``."""
    if text_size(text, height_px)[0] <= width_px:
        return text
    while text and text_size(text + "..", height_px)[0] > width_px:
        text = text[:-1]
    return text + ".."


def _thickness(height_px: float) -> int:
    return max(1, round(height_px / 11))
