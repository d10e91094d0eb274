"""Write a user's own recording by hand: two cameras, whatever lines are given."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

RIG = """
cameras:
  left: {size: [40, 30], focal: 30, position: [1.0, 0.4, 1.4], yaw_deg: 90}
  right: {size: [40, 30], focal: 30, position: [1.0, -0.4, 1.4], yaw_deg: -90}
"""
QUARTER_TURN = {"translation_m": [10.0, 20.0, 0.5], "quaternion_wxyz": [0.5**0.5, 0, 0, 0.5**0.5]}
"""The vehicle stands at (10, 20, 0.5) and looks along world +y."""
CAR: dict[str, Any] = {
    "category": "car", "centre_m": [5.0, 1.0, 0.8], "length_m": 4.0, "width_m": 2.0, "height_m": 1.6, "yaw_rad": 0.25,
}  # fmt: skip


def write_folder(root: Path, *lines: dict[str, Any] | str, rig: str = RIG) -> Path:
    """The folder with its rig, these lines, and both images of frames 0 to 2."""
    root.mkdir(parents=True, exist_ok=True)
    (root / "rig.yaml").write_text(rig)
    for camera in ("left", "right"):
        (root / camera).mkdir(exist_ok=True)
        for frame in range(3):
            cv2.imwrite(str(root / camera / f"{frame}.png"), np.full((30, 40, 3), 40 * frame, dtype=np.uint8))
    written = [line if isinstance(line, str) else json.dumps(line) for line in lines]
    (root / "frames.jsonl").write_text("\n".join(written) + "\n")
    return root


def line(frame: int = 0, **more: Any) -> dict[str, Any]:
    """A minimal line of frame 0, 1 or 2, and what else it says; None takes a key away."""
    images = {"left": f"left/{frame}.png", "right": f"right/{frame}.png"}
    entry = {"token": f"f{frame}", "images": images, **more}
    return {key: value for key, value in entry.items() if value is not None}
