"""A training view: an image, its camera, and how it becomes network input."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from coin3d.datasets.frame import Frame
from coin3d.geometry import Camera, ImageTransform


@dataclass(frozen=True, eq=False)
class RecordedImage:
    """The image of a frame, read when it is known at which size.

    Args:
        frame: whose.
        camera: which.
    """

    frame: Frame
    camera: str


@dataclass(frozen=True, eq=False)
class View:
    """One camera's image on its way into the network.

    Args:
        image: recorded, or (h, w, 3) RGB that was rendered.
        camera: the camera of ``image``.
        transform: from ``image`` to the network input; augmentations extend it, so pixels are resampled once.
    """

    image: UInt8[np.ndarray, "h w 3"] | RecordedImage
    camera: Camera
    transform: ImageTransform

    def network_image(self) -> UInt8[np.ndarray, "H W 3"]:
        """The network input before normalisation. A recorded image is decoded no larger than it takes."""
        if isinstance(self.image, RecordedImage):
            pixels = self.image.frame.image(self.image.camera, at_least_px=self.transform.resized)
            averaged = self.transform.resized[0] < pixels.shape[1] < min(2 * self.transform.resized[0], self.camera.width_px)
            return self.transform.image(pixels, averaged=averaged)
        return self.transform.image(self.image)

    def network_camera(self) -> Camera:
        """The camera of the network input."""
        return self.transform.camera(self.camera)


ViewAugmentation = Callable[[View, np.random.Generator], View]
"""Changes one training view; the camera must keep telling the truth."""

FrameAugmentation = Callable[[Frame, Sequence[str], tuple[int, int], np.random.Generator], list[View] | None]
"""Makes the views of a sample from (frame, names of the chosen cameras, (width, height) of the network input, generator),
in place of its raw images; None keeps those. The number of views and their cameras are free."""
