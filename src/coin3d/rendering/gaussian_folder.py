"""Where the Gaussians of a recording's frames lie on disk: one file per frame, ``<scene>/<token>.safetensors``."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from coin3d.rendering.gaussian_file import load_gaussians
from coin3d.rendering.gaussians import Gaussians

SCENES_FILE = "scenes.json"
"""Beside the scenes' folders; its list ``raw_only`` names scenes that are never rendered for training."""


@dataclass(frozen=True)
class GaussianFolder:
    """What the scene builder wrote. Frames may lack Gaussians, scenes may be set aside.

    Args:
        root: the folder.
        raw_only: scenes to leave alone, for instance because a body came out badly.
    """

    root: Path
    raw_only: frozenset[str] = frozenset()

    @classmethod
    def open(cls, root: Path) -> GaussianFolder:
        """Look at a folder that the scene builder wrote.

        Raises:
            FileNotFoundError: no such folder, or no Gaussians in it.
            ValueError: ``scenes.json`` is damaged.
        """
        if not root.is_dir():
            raise FileNotFoundError(f"{root}: no such folder of Gaussians")
        if next(root.glob("*/*.safetensors"), None) is None:
            raise FileNotFoundError(f"{root}: holds no <scene>/<frame token>.safetensors; give the folder of built scenes")
        path = root / SCENES_FILE
        if not path.is_file():
            return cls(root)
        try:
            content = json.loads(path.read_bytes())
            names = content.get("raw_only", [])
            if not isinstance(names, list):
                raise ValueError("raw_only is not a list")
        except (ValueError, AttributeError) as error:
            raise ValueError(f"{path}: not a JSON object with a list 'raw_only' of scene names ({error})") from error
        return cls(root, frozenset(map(str, names)))

    def path(self, scene: str, token: str) -> Path:
        """The file of a frame, whether it exists or not."""
        return self.root / scene / f"{token}.safetensors"

    def load(self, scene: str, token: str) -> Gaussians | None:
        """The Gaussians of a frame, None where there are none to be used.

        Raises:
            ValueError: the file is damaged.
        """
        path = self.path(scene, token)
        return None if scene in self.raw_only or not path.is_file() else load_gaussians(path)
