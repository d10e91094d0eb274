"""The plug between a detector and a method of transfer. A detector calls these hooks and knows no method by name."""

from __future__ import annotations

from typing import Any

from jaxtyping import Float
from torch import Tensor, nn

from coin3d.augmentation import FrameAugmentation, ViewAugmentation
from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.rendering.gaussian_folder import GaussianFolder


class Method(nn.Module):
    """The method that does nothing; others override the hooks they need.

    A detector calls, in this order: ``attach_*`` once while it is built; then per forward ``prepare``, ``image``,
    ``modulate`` at each attached level, and ``camera_vector`` before depth is estimated.
    """

    view_augmentation: ViewAugmentation | None = None
    """Applied to every raw training view in the loader, before the generic image augmentation."""

    def frame_augmentation(self, gaussians: GaussianFolder | None) -> FrameAugmentation | None:
        """What may make all views of a training sample in place of its raw images, or None.

        Args:
            gaussians: the frames as Gaussians, if training was given any.

        Raises:
            ValueError: the method needs them.
        """
        return None

    @property
    def extra_image_channels(self) -> int:
        """Channels ``image`` adds to RGB."""
        return 0

    @property
    def camera_vector_channels(self) -> int:
        """Length of ``camera_vector``; 0 builds the detector without a camera-aware gate."""
        return 0

    def attach(self, level: str, channels: int, stride: int) -> int:
        """Announce a feature level (``backbone_<stride>`` or ``neck``); returns its channel count after ``modulate``."""
        return channels

    def prepare(self, cameras: CameraTensors) -> Any:
        """Whatever the other hooks need of the cameras, computed once per forward."""
        return None

    def image(self, images: Float[Tensor, "m 3 h w"], context: Any) -> Float[Tensor, "m c h w"]:
        """The network input, ``3 + extra_image_channels`` channels."""
        return images

    def modulate(self, level: str, features: Float[Tensor, "m c h w"], context: Any) -> Float[Tensor, "m k h w"]:
        """Features of an attached level with the cameras' configuration worked in."""
        return features

    def camera_vector(
        self, cameras: CameraTensors, bev_from_ego: Float[Tensor, "m 3 3"], context: Any
    ) -> Float[Tensor, "m k"] | None:
        """Numbers that gate the depth network, or None."""
        return None
