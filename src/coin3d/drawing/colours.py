"""Colours: of classes, of truth and predictions, and of scalar maps."""

from __future__ import annotations

import zlib

import matplotlib
import numpy as np
from jaxtyping import Float, UInt8

RGB = tuple[int, int, int]

BACKGROUND: RGB = (22, 24, 28)
TEXT: RGB = (235, 235, 235)
FAINT: RGB = (110, 114, 122)
# as in the paper's figures: truth red, predictions green
TRUTH: RGB = (255, 90, 80)
PREDICTION: RGB = (70, 220, 120)

# first match wins, so that "vehicle.bus.rigid" is a bus before it is a vehicle
_BY_WORD: tuple[tuple[str, RGB], ...] = (
    ("pedestrian", (80, 170, 255)),
    ("two-wheel", (255, 105, 210)),
    ("cyclist", (255, 105, 210)),
    ("cycle", (255, 105, 210)),
    ("truck", (255, 205, 60)),
    ("trailer", (255, 205, 60)),
    ("bus", (190, 230, 70)),
    ("construction", (205, 140, 70)),
    ("car", (255, 150, 50)),
    ("vehicle", (255, 150, 50)),
    ("barrier", (165, 145, 220)),
    ("cone", (140, 220, 220)),
)


def class_colour(name: str) -> RGB:
    """The colour of a class or category; names nobody listed get a steady colour of their own."""
    lowered = name.lower()
    for word, colour in _BY_WORD:
        if word in lowered:
            return colour
    hue = (zlib.crc32(lowered.encode()) % 360) / 360
    red, green, blue = matplotlib.colors.hsv_to_rgb((hue, 0.45, 0.9))
    return int(255 * red), int(255 * green), int(255 * blue)


def colour_map(
    values: Float[np.ndarray, "..."],
    low: float | None = None,
    high: float | None = None,
    name: str = "turbo",
    invalid: RGB = (0, 0, 0),
) -> UInt8[np.ndarray, "... 3"]:
    """Scalars as colours of a matplotlib colour map.

    Args:
        values: any shape; what is not finite gets the colour ``invalid``.
        low: value at the lower end, default the smallest finite one.
        high: value at the upper end, default the largest finite one.
        name: matplotlib's name of the map.
        invalid: colour of values that are not finite.
    """
    values = np.asarray(values, dtype=np.float64)
    finite = np.isfinite(values)
    if low is None:
        low = float(values[finite].min()) if finite.any() else 0.0
    if high is None:
        high = float(values[finite].max()) if finite.any() else 1.0
    share = np.where(finite, (values - low) / max(high - low, 1e-12), 0.0).clip(0.0, 1.0)
    colours = (np.asarray(matplotlib.colormaps[name](share))[..., :3] * 255).round().astype(np.uint8)
    colours[~finite] = invalid
    return colours
