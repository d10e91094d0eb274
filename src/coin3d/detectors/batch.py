"""What a detector reads: images of any number of cameras, flattened, with the sample each belongs to."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from torch import Tensor

from coin3d.geometry import Boxes3D
from coin3d.geometry.camera_tensors import CameraTensors

IMAGE_MEAN = (0.485, 0.456, 0.406)
IMAGE_STD = (0.229, 0.224, 0.225)
"""ImageNet's, for red, green and blue in 0 to 1."""


@dataclass(frozen=True, eq=False)
class Batch:
    """M camera images of B samples. Rigs may differ between samples; there are no padded 'ghost' cameras.

    Args:
        images: (M, 3, H, W) RGB, normalised.
        cameras: the M cameras after image augmentation.
        sample_index: (M,) sample of each camera, rising.
        bev_from_ego: (B, 3, 3) BEV augmentation (rotation, scale, flip); identity outside training.
        depth_m: (M, H, W) sparse LiDAR depth, 0 where unknown; only for training.
        boxes: B tables of ground truth in the augmented BEV frame; only for training.
        key_from_ego: (M, 4, 4) from the ego frame that each camera's pose is given in to that of its sample, where they
            differ: images of an earlier frame keep their own ego, so that their priors do.
        previous: the frames before, of the same B samples in the same order, for detectors that look back; those may bring
            the ones before them. ``key_from_ego`` of each leads to the first batch of the chain.
    """

    images: Float[Tensor, "m 3 h w"]
    cameras: CameraTensors
    sample_index: Int[Tensor, "m"]
    bev_from_ego: Float[Tensor, "b 3 3"]
    depth_m: Float[Tensor, "m h w"] | None = None
    boxes: tuple[Boxes3D, ...] = ()
    key_from_ego: Float[Tensor, "m 4 4"] | None = None
    previous: Batch | None = None

    @property
    def lift_cameras(self) -> CameraTensors:
        """The cameras with poses in the ego frames of the samples."""
        if self.key_from_ego is None:
            return self.cameras
        # double: under autocast a product in single precision would be one in half precision
        moved: Tensor = self.key_from_ego.double() @ self.cameras.ego_from_cam.double()
        return replace(self.cameras, ego_from_cam=moved.to(self.cameras.ego_from_cam.dtype))

    @property
    def previous_from_ego(self) -> Float[Tensor, "b 4 4"]:
        """From the ego frames of the samples to those of the frames before.

        Raises:
            ValueError: no frames before, or one whose motion nobody told.
        """
        before = self.previous
        if before is None or before.key_from_ego is None:
            raise ValueError("the motion since the frames before is not known: they need key_from_ego")
        samples = torch.arange(self.num_samples, device=self.sample_index.device)
        first, first_before = (torch.searchsorted(batch.sample_index, samples) for batch in (self, before))
        motion: Tensor = torch.linalg.inv(before.key_from_ego[first_before].double())
        if self.key_from_ego is not None:  # this is itself a frame before another
            motion = motion @ self.key_from_ego[first].double()
        return motion.to(before.key_from_ego.dtype)

    @property
    def num_samples(self) -> int:
        return len(self.bev_from_ego)

    def to(self, device: torch.device | str) -> Batch:
        return replace(
            self,
            images=self.images.to(device),
            cameras=self.cameras.to(device),
            sample_index=self.sample_index.to(device),
            bev_from_ego=self.bev_from_ego.to(device),
            depth_m=None if self.depth_m is None else self.depth_m.to(device),
            key_from_ego=None if self.key_from_ego is None else self.key_from_ego.to(device),
            previous=None if self.previous is None else self.previous.to(device),
        )


def normalise_image(image: UInt8[np.ndarray, "h w 3"]) -> Float[Tensor, "3 h w"]:
    """RGB bytes to the network's range (ImageNet mean and standard deviation)."""
    scaled = torch.from_numpy(np.ascontiguousarray(image)).permute(2, 0, 1).float() / 255
    return (scaled - torch.tensor(IMAGE_MEAN)[:, None, None]) / torch.tensor(IMAGE_STD)[:, None, None]
