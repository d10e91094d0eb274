"""Where the Gaussians of a recording's frames lie on disk: one file per frame, ``<scene>/<token>.safetensors``."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from coin3d.geometry import Rig, load_rig
from coin3d.rendering.gaussian_file import load_gaussians
from coin3d.rendering.gaussians import Gaussians

RIG_FILE = "rig.yaml"
"""In a scene's folder: the rig of its first frame."""

SCENES_FILE = "scenes.json"
"""Beside the scenes' folders; its ``raw_only`` names scenes never to be rendered for training, each with the reason."""


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
            names = content.get("raw_only", {})
            if not isinstance(names, dict):
                raise ValueError("raw_only is not an object")
        except (ValueError, AttributeError, RecursionError) as error:
            raise ValueError(f"{path}: not a JSON object with scene -> reason under 'raw_only' ({error})") from error
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
        if path.parent.parent != self.root:
            raise ValueError(f"{self.root}: the scene '{scene}' or frame '{token}' is no name of a file")
        return None if scene in self.raw_only or not path.is_file() else load_gaussians(path)


def find_frame(path: Path) -> Path:
    """The file of one frame: the path itself, or the middle frame of a scene's folder.

    Raises:
        FileNotFoundError: nothing there, or a folder that is no built scene.
    """
    if path.is_file():
        return path
    # a scene's folder also holds the products of its steps; a frame's file has a rating of the same name
    files = sorted(file for file in path.glob("*.safetensors") if (path / "quality" / f"{file.stem}.json").is_file())
    if not files:
        raise FileNotFoundError(f"{path}: holds no built frames; give the folder of a scene that coin3d build-scenes wrote")
    return files[len(files) // 2]


def recorded_rig(frame: Path) -> Rig:
    """The rig a frame's images were recorded with.

    Raises:
        FileNotFoundError: the scene's folder does not say.
    """
    path = frame.parent / RIG_FILE
    if not path.is_file():
        raise FileNotFoundError(f"{path}: not there, so the rig of the recording is unknown; name a rig with --rig")
    return load_rig(path)
