"""A user's own images beside a ``rig.yaml``: no labels, no LiDAR."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from coin3d.datasets.frame import Frame
from coin3d.datasets.own_vehicle import own_vehicle_masks
from coin3d.geometry import load_rig

RIG_FILE = "rig.yaml"
_IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png")


class FolderRecording:
    """Either one frame, ``<camera>.jpg``, or many, ``<camera>/<frame>.jpg``; PNG as well.

    Images of one frame share their name without suffix. Frames come in the order of their names, numbers by value.
    Time is unknown: ``timestamp_ns`` is 0.

    Args:
        root: folder with ``rig.yaml`` and the images.

    Raises:
        FileNotFoundError: no rig file.
        ValueError: the rig file makes no sense, or cameras lack images.
    """

    def __init__(self, root: Path | str) -> None:
        self.root = Path(root)
        self.rig = load_rig(self.root / RIG_FILE)
        folders = [c for c in self.rig if (self.root / c).is_dir()]
        if folders:
            images = {c: _images_by_stem(self.root / c) for c in self.rig}
            self._images = _by_frame(images, self.root)
        else:
            present = _images_by_stem(self.root)
            missing = [c for c in self.rig if c not in present]
            if missing:
                raise ValueError(
                    f"{self.root}: no images of the cameras {', '.join(missing)} that {RIG_FILE} names; expected "
                    f"{missing[0]}.jpg (one frame) or {missing[0]}/<frame>.jpg (many), also .png"
                )
            self._images = {self.root.name: {c: present[c] for c in self.rig}}
        self._tokens = sorted(self._images, key=_natural)

    def __len__(self) -> int:
        return len(self._tokens)

    def __iter__(self) -> Iterator[Frame]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, index: int) -> Frame:
        """The frame at a position; raises IndexError beyond the end."""
        index = range(len(self))[index]
        token = self._tokens[index]
        neighbours = ["", *self._tokens, ""]
        return Frame(
            token=token,
            timestamp_ns=0,
            rig=self.rig,
            images=self._images[token],
            scene=self.root.name,
            previous=neighbours[index],
            next=neighbours[index + 2],
            own_vehicle=own_vehicle_masks(self.root, self.rig),
        )


def _images_by_stem(folder: Path) -> dict[str, Path]:
    found: dict[str, Path] = {}
    for path in sorted(folder.iterdir()) if folder.is_dir() else []:
        if path.suffix.lower() in _IMAGE_SUFFIXES:
            if path.stem in found:
                raise ValueError(f"{folder}: both {found[path.stem].name} and {path.name}; keep one image per frame")
            found[path.stem] = path
    return found


def _by_frame(images: dict[str, dict[str, Path]], root: Path) -> dict[str, dict[str, Path]]:
    stems = {stem for by_stem in images.values() for stem in by_stem}
    if not stems:
        raise ValueError(f"{root}: the camera folders hold no images ({', '.join(_IMAGE_SUFFIXES)})")
    for camera, by_stem in images.items():
        missing = sorted(stems - set(by_stem), key=_natural)
        if missing:
            more = f" and {len(missing) - 3} more" if len(missing) > 3 else ""
            raise ValueError(
                f"{root}: camera '{camera}' lacks the frames {', '.join(missing[:3])}{more} that other cameras have; "
                f"add {camera}/{missing[0]}.jpg, or remove the frame from the others"
            )
    return {stem: {camera: by_stem[stem] for camera, by_stem in images.items()} for stem in stems}


def _natural(name: str) -> list[tuple[int, str]]:
    # digits compare by value: frame 2 before frame 10
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name) if part]
