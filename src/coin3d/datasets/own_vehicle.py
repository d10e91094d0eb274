"""Where a camera sees the vehicle that carries it: one mask per camera, beside any recording."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

FOLDER = "own_vehicle"


def own_vehicle_masks(root: Path, cameras: Iterable[str]) -> dict[str, Path]:
    """The masks there are: ``root/own_vehicle/<camera>.png``, of the image's size, not black where the vehicle is seen."""
    paths = {camera: root / FOLDER / f"{camera}.png" for camera in cameras}
    return {camera: path for camera, path in paths.items() if path.is_file()}
