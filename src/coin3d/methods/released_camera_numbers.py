"""The camera's numbers as Megvii's released depth net reads them, for its weights only (spec detectors 1.5)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.priors.released import from_whole_pixels


@dataclass(frozen=True)
class ReleasedCameraNumbers:
    """Intrinsics and image augmentation apart: 4 + 6 + 5 + 12 = 27 numbers.

    A camera of this project carries one K with everything folded in. The augmentation is therefore taken to be that of the
    released tests, resizing an image of the size below and keeping its bottom; the rest of K counts as the camera's own. For
    nuScenes images these are the released numbers exactly.

    Args:
        source_width_px: width of the images that the weights were trained on.
        source_height_px: and their height.
    """

    source_width_px: int = 1600
    source_height_px: int = 900

    @property
    def count(self) -> int:
        return 27

    def vector(self, cameras: CameraTensors, bev_from_ego: Float[Tensor, "m 3 3"]) -> Float[Tensor, "m 27"]:
        """Numbers of M cameras, in the released order and unit (pixels, metres; nothing is normalised)."""
        scale = cameras.width_px / self.source_width_px
        cut_px = scale * self.source_height_px - cameras.height_px
        K = from_whole_pixels(cameras.K)
        own = torch.stack([K[:, 0, 0], K[:, 1, 1], K[:, 0, 2], K[:, 1, 2] + cut_px], dim=1) / scale
        image = own.new_tensor([scale, 0.0, 0.0, 0.0, scale, -cut_px]).expand(len(K), 6)
        bev = bev_from_ego[:, (0, 0, 1, 1, 2), (0, 1, 0, 1, 2)]
        return torch.cat([own.to(bev.dtype), image.to(bev.dtype), bev, cameras.ego_from_cam[:, :3].flatten(1)], dim=1)
