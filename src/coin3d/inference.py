"""From a checkpoint and images to boxes: ``coin3d.load(checkpoint).detect(images, rig)``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from coin3d.datasets.frame import Frame, Recording
from coin3d.datasets.image_source import ImageSource
from coin3d.datasets.undistorted import UndistortedRecording, undistorted
from coin3d.detectors import Detector
from coin3d.geometry import Boxes3D, Rig
from coin3d.training.checkpoint import load_checkpoint
from coin3d.training.predict import Precision, predict

SHIPPED = ("town-direct", "town-coin3d")
"""Names of the checkpoints that come with the package (docs/results.md says how they were made)."""

WEIGHTS_FOLDER = Path(__file__).parent / "weights"

TOWN_ONLY = (
    "The shipped weights know only the town, a synthetic street world: they have never seen a real street, and boxes they "
    "give on real images mean nothing. Weights for real streets come by converting released "
    "checkpoints (coin3d convert), or by training on your own recordings (coin3d train)."
)


@dataclass(frozen=True, eq=False)
class LoadedDetector:
    """A trained detector, ready for any rig.

    Args:
        model: the network, in evaluation mode.
        description: what the checkpoint says of itself: detector, config, classes, method, options, notes, training rigs.
        path: where it was loaded from.
        device: where it runs.
        precision: number format of the network.
    """

    model: Detector
    description: Mapping[str, Any]
    path: Path
    device: str = "cpu"
    precision: Precision = "float32"

    @property
    def classes(self) -> tuple[str, ...]:
        """What it can find."""
        return self.model.classes

    @property
    def source(self) -> str:
        """Names of the recordings it was trained on, as far as the checkpoint tells."""
        notes = str(self.description.get("notes", ""))
        recordings, found, _ = notes.removeprefix("trained on ").rpartition(" for ")
        return recordings if found else notes or "unknown"

    @property
    def note(self) -> str:
        """What the weights have seen, for every result made with them."""
        if self.path.resolve().parent == WEIGHTS_FOLDER.resolve():
            return TOWN_ONLY
        return f"These weights: {self.description.get('notes') or 'nothing is written about their training'}."

    def detect(self, images: Mapping[str, np.ndarray | Path | str], rig: Rig) -> Boxes3D:
        """Detect objects in the images of one instant.

        Args:
            images: camera name -> RGB pixels (h, w, 3) uint8, or an image file; one for every camera of the rig.
            rig: calibration of the cameras; images of cameras with lenses are undistorted first.

        Returns:
            Boxes in the ego frame (x forward, y left, z up, metres), best score first.

        Raises:
            ValueError: an image is missing, not among the cameras, not RGB bytes, or of a size that contradicts the rig.
        """
        if missing := [name for name in rig if name not in images]:
            raise ValueError(f"no image of the camera {', '.join(missing)}: rig '{rig.name}' has {', '.join(rig)}")
        if unknown := [name for name in images if name not in rig]:
            raise ValueError(f"image of {', '.join(unknown)}, but rig '{rig.name}' only has the cameras {', '.join(rig)}")
        sources = {name: _source(name, images[name]) for name in rig}
        return self.detect_frames([Frame("images", 0, rig, sources)])["images"]

    def detect_frames(
        self, frames: Sequence[Frame], progress: Callable[[str], None] | None = None, *, recording: Recording | None = None
    ) -> dict[str, Boxes3D]:
        """Detect in frames of a recording, one after the other; returns token -> boxes in the ego frame.

        Detectors that look back find earlier frames in ``recording``, or else among ``frames``.
        """
        straight = [undistorted(frame) for frame in frames]
        before = None if recording is None else UndistortedRecording(recording)
        return predict(self.model, straight, recording=before, precision=self.precision, device=self.device, progress=progress)


def load(
    checkpoint: str | Path, device: str = "auto", *, precision: Precision = "float32", compiled: bool = False
) -> LoadedDetector:
    """Load a checkpoint.

    Args:
        checkpoint: a shipped name (``town-direct``, ``town-coin3d``) or the path of a checkpoint that ``coin3d train`` or
            ``coin3d convert`` wrote.
        device: ``auto`` takes a GPU if there is one; or a name such as ``cpu``, ``cuda:1``.
        precision: ``bfloat16`` may be faster where the hardware has it; boxes move a little.
        compiled: compile the image trunk and neck with torch.compile at the first frame, which takes a while and, on a CPU,
            a C++ compiler.

    Raises:
        FileNotFoundError: no such checkpoint.
        ValueError: not a checkpoint of this project, or one that does not fit together.
    """
    path = checkpoint_path(checkpoint)
    model, description = load_checkpoint(path)
    if compiled:
        model.compile_trunk()
    return LoadedDetector(model, description, path, resolve_device(device), precision)


def checkpoint_path(checkpoint: str | Path) -> Path:
    """The file of a shipped name or a path.

    Raises:
        FileNotFoundError: neither of the two.
    """
    path = Path(checkpoint)
    if str(checkpoint) in SHIPPED and not path.exists():
        path = WEIGHTS_FOLDER / f"{checkpoint}.safetensors"
        if not path.is_file():
            raise FileNotFoundError(f"{path}: this installation lacks the shipped weights '{checkpoint}'; install it again")
    if not path.is_file():
        raise FileNotFoundError(f"{checkpoint}: no such checkpoint; give a file, or a shipped name: {', '.join(SHIPPED)}")
    return path


def resolve_device(name: str) -> str:
    """``auto`` to ``cuda`` or ``cpu``.

    Raises:
        ValueError: a device that this machine does not have.
    """
    if name == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    try:
        torch.zeros(1, device=name)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).partition("\n")[0]
        raise ValueError(f"the device '{name}' cannot be used here ({reason}); take --device cpu") from error
    return name


def _source(camera: str, image: np.ndarray | Path | str) -> ImageSource:
    if not isinstance(image, np.ndarray):
        return Path(image)
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise ValueError(f"image of {camera}: RGB bytes of shape (h, w, 3) are needed, got {image.dtype} {image.shape}")
    return image
