"""Frames whose cameras have lenses, as if pinhole cameras had taken them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8

from coin3d.datasets.frame import Frame, Recording
from coin3d.datasets.image_source import ImageSource, load_image
from coin3d.geometry import Camera, Pinhole
from coin3d.geometry.undistort import has_lens, undistort_image, undistorted_rig


@dataclass(frozen=True, eq=False)
class UndistortedImage:
    """An image that is resampled to ``pinhole_camera(camera)`` when it is loaded.

    Args:
        source: as recorded.
        camera: that recorded it, with its lens.
        is_mask: of a mask, what any pixel has a share of counts.
    """

    source: ImageSource
    camera: Camera
    is_mask: bool = False

    def load(self, reduction: int = 1) -> UInt8[np.ndarray, "h w 3"]:
        """The resampled RGB image, ``reduction`` times smaller.

        Raises:
            ValueError: the image is missing or damaged, or its size contradicts the camera.
        """
        pixels = load_image(self.source, reduction)
        if self.is_mask:
            pixels = np.where(pixels.any(-1) if pixels.ndim == 3 else pixels != 0, 255, 0).astype(np.uint8)
        try:
            pixels = undistort_image(pixels, self.camera, reduction)
        except ValueError as error:
            raise ValueError(f"{self}: {error}") from error
        return (
            np.asarray(cv2.cvtColor(np.where(pixels > 0, 255, 0).astype(np.uint8), cv2.COLOR_GRAY2RGB))
            if self.is_mask
            else pixels
        )

    def __str__(self) -> str:
        return "image in memory" if isinstance(self.source, np.ndarray) else str(self.source)


def undistorted(frame: Frame) -> Frame:
    """The frame with pinhole cameras and images resampled when they are asked for; the same object if it has no lenses.

    Which pinhole camera stands in for a lens: ``coin3d.geometry.undistort.pinhole_camera``.

    Raises:
        ValueError: a camera whose principal point is outside its image.
    """
    if not has_lens(frame.rig):
        return frame
    return replace(
        frame,
        rig=undistorted_rig(frame.rig),
        images=_resampled(frame, frame.images, is_mask=False),
        own_vehicle=_resampled(frame, frame.own_vehicle, is_mask=True),
    )


def _resampled(frame: Frame, sources: Mapping[str, ImageSource], *, is_mask: bool) -> dict[str, ImageSource]:
    cameras = {name: frame.rig[name] for name in sources}
    return {
        name: source if isinstance(cameras[name].lens, Pinhole) else UndistortedImage(source, cameras[name], is_mask)
        for name, source in sources.items()
    }


@dataclass(frozen=True, eq=False)
class UndistortedRecording:
    """A recording whose frames come undistorted. What else its format offers is passed on.

    Args:
        recorded: as it is on disk.
    """

    recorded: Recording

    def __len__(self) -> int:
        return len(self.recorded)

    def __getitem__(self, index: int) -> Frame:
        return undistorted(self.recorded[index])

    def __iter__(self) -> Iterator[Frame]:
        return map(undistorted, self.recorded)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name == "recorded":  # asked for while being unpickled, before there is anything
            raise AttributeError(name)
        return getattr(self.recorded, name)
