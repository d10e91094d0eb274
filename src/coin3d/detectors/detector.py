"""What every detector is to the rest of the project: images and cameras in, losses or boxes out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Protocol, runtime_checkable

from jaxtyping import Float
from torch import Tensor, nn

from coin3d.detectors.batch import Batch
from coin3d.detectors.method import Method
from coin3d.geometry import Boxes3D


@runtime_checkable
class DetectorConfig(Protocol):
    """What is read of a configuration outside of its detector."""

    @property
    def image_width_px(self) -> int:
        """Images are resized to this width."""

    @property
    def image_height_px(self) -> int:
        """And the bottom rows kept."""

    @property
    def frames(self) -> int:
        """How many frames are looked at: 1, or the earlier ones as well."""


class Detector(nn.Module, ABC):
    """A detector with a method of transfer attached to it; the method's weights are among its own."""

    name: str
    config: DetectorConfig
    classes: tuple[str, ...]
    method: Method

    @abstractmethod
    def losses(self, batch: Batch) -> dict[str, Float[Tensor, ""]]:
        """Weighted losses by name; their sum is what is minimised.

        Raises:
            ValueError: the batch lacks what the losses need.
        """

    @abstractmethod
    def detect(self, batch: Batch) -> list[Boxes3D]:
        """Boxes of each sample in the ego frame (the batch carries no BEV augmentation), best first."""

    def compile_trunk(self) -> None:
        """Compile image trunk and neck at their next forward; what follows them depends on the rig and stays as it is."""
        for part in ("backbone", "neck"):
            self.get_submodule(part).compile()
