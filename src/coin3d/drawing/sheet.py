"""A sheet of labelled pictures of unequal sizes, and writing pictures to disk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from coin3d.drawing.colours import BACKGROUND, FAINT, RGB, TEXT, class_colour
from coin3d.drawing.text import put_text, shortened, text_size
from coin3d.records import write_bytes

_GAP = 8
_CAPTION = 26
_TEXT = 11.0


@dataclass(frozen=True, eq=False)
class Panel:
    """A picture and what to write above it."""

    image: UInt8[np.ndarray, "h w 3"]
    caption: str


def sheet(
    panels: Sequence[Panel], columns: int, cell_width_px: int = 640, title: str = "", legend: Sequence[tuple[str, RGB]] = ()
) -> UInt8[np.ndarray, "H W 3"]:
    """Panels in rows of ``columns``, each scaled to ``cell_width_px``; a row is as high as its highest picture.

    Args:
        panels: at least one.
        columns: panels per row.
        cell_width_px: width of a cell.
        title: line above everything.
        legend: (text, colour) pairs on a line at the bottom, wrapped where the sheet is narrow.

    Raises:
        ValueError: no panels.
    """
    if not panels:
        raise ValueError("a sheet needs at least one panel")
    columns = min(columns, len(panels))
    width = columns * (cell_width_px + _GAP) + _GAP
    parts = [_title_bar(title, width)] if title else [np.full((_GAP, width, 3), BACKGROUND, dtype=np.uint8)]
    for start in range(0, len(panels), columns):
        parts.append(_row(panels[start : start + columns], width, cell_width_px))
    if legend:
        parts.append(_legend(legend, width))
    return np.concatenate(parts)


def class_legend(labels: Sequence[str]) -> list[tuple[str, RGB]]:
    """Legend entries of class names, each once."""
    return [(label, class_colour(label)) for label in sorted(set(map(str, labels)))]


def message_picture(text: str, width_px: int, height_px: int) -> UInt8[np.ndarray, "h w 3"]:
    """A dark picture that says why there is none; long text is wrapped."""
    out = np.full((height_px, width_px, 3), (48, 30, 30), dtype=np.uint8)
    size = max(10.0, width_px / 50)
    line, row = "", 1
    for word in [*text.split(), ""]:
        if not word or text_size(f"{line} {word}", size)[0] > width_px * 0.92:
            put_text(out, shortened(line, size, width_px * 0.92), width_px * 0.04, row * size * 2.2, size, TEXT)
            line, row = word, row + 1
        else:
            line = f"{line} {word}".strip()
    return out


def save_png(image: UInt8[np.ndarray, "h w 3"], path: Path) -> Path:
    """Write an RGB picture: under a temporary name first, so that a file with the name is always whole."""
    encoded, data = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    if not encoded:
        raise ValueError(f"{path}: an image of shape {image.shape} cannot be encoded as PNG")
    write_bytes(path, data.tobytes())
    return path


def _row(panels: Sequence[Panel], width: int, cell_width: int) -> UInt8[np.ndarray, "h w 3"]:
    pictures = [_scaled(p.image, cell_width) for p in panels]
    out = np.full((_CAPTION + max(p.shape[0] for p in pictures) + _GAP, width, 3), BACKGROUND, dtype=np.uint8)
    for column, (panel, picture) in enumerate(zip(panels, pictures, strict=True)):
        left = _GAP + column * (cell_width + _GAP)
        caption = shortened(panel.caption, _TEXT, cell_width)
        put_text(out, caption, left + 2, _CAPTION - 8, _TEXT, TEXT, outlined=False)
        out[_CAPTION : _CAPTION + picture.shape[0], left : left + cell_width] = picture
    return out


def _scaled(image: UInt8[np.ndarray, "h w 3"], width: int) -> UInt8[np.ndarray, "H W 3"]:
    if image.shape[1] == width:
        return image
    height = max(1, round(image.shape[0] * width / image.shape[1]))
    shrinks = width < image.shape[1]
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_CUBIC))


def _title_bar(title: str, width: int) -> UInt8[np.ndarray, "h w 3"]:
    out = np.full((44, width, 3), BACKGROUND, dtype=np.uint8)
    put_text(out, shortened(title, 15, width - 2 * _GAP), _GAP + 2, 29, 15, TEXT, outlined=False)
    return out


def _legend(legend: Sequence[tuple[str, RGB]], width: int) -> UInt8[np.ndarray, "h w 3"]:
    places: list[tuple[int, int]] = []
    left, row = _GAP + 4, 0
    for text, _ in legend:
        needed = 46 + text_size(text, _TEXT)[0]
        if left + needed > width and left > _GAP + 4:
            left, row = _GAP + 4, row + 1
        places.append((left, row))
        left += needed
    out = np.full((30 * (row + 1) + 6, width, 3), BACKGROUND, dtype=np.uint8)
    for (text, colour), (left, line) in zip(legend, places, strict=True):
        top = 30 * line + 8
        cv2.rectangle(out, (left, top), (left + 16, top + 12), colour, -1)
        cv2.rectangle(out, (left, top), (left + 16, top + 12), FAINT, 1)
        put_text(out, text, left + 24, top + 12, _TEXT, TEXT, outlined=False)
    return out
