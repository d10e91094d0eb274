"""Direct transfer (paper tables, row "Direct Transfer"): BEVDepth with its own camera-aware squeeze-and-excitation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from coin3d.augmentation import FrameAugmentation, NovelViewOptions, novel_views
from coin3d.detectors.method import Method
from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.methods.released_camera_numbers import ReleasedCameraNumbers
from coin3d.rendering.gaussian_folder import GaussianFolder


@dataclass(frozen=True)
class DirectOptions:
    """What direct transfer can be given beyond the detector's own means.

    Args:
        novel_views: train on rendered views as well (paper table GDA_ablation_v2, CDA with camera-aware SE).
        released: numbers as Megvii's released weights need them.
    """

    novel_views: NovelViewOptions | None = None
    released: ReleasedCameraNumbers | None = None


class Direct(Method):
    """Gives the depth net the camera's numbers: K with the image augmentation folded in, BEV augmentation, mounting.

    Spec detectors 1.5 lists 27 numbers with intrinsics and image augmentation apart; here they are multiplied out,
    because a camera of this project carries one K: 6 + 5 + 12 = 23.
    """

    def __init__(self, options: DirectOptions | None = None) -> None:
        super().__init__()
        self.options = options or DirectOptions()

    def frame_augmentation(self, gaussians: GaussianFolder | None) -> FrameAugmentation | None:
        return novel_views(self.options.novel_views, gaussians)

    @property
    def camera_vector_channels(self) -> int:
        return 23 if self.options.released is None else self.options.released.count

    def camera_vector(self, cameras: CameraTensors, bev_from_ego: Float[Tensor, "m 3 3"], context: Any) -> Float[Tensor, "m k"]:
        if self.options.released is not None:
            return self.options.released.vector(cameras, bev_from_ego)
        intrinsics = cameras.K[:, :2].flatten(1)
        bev = bev_from_ego[:, (0, 0, 1, 1, 2), (0, 1, 0, 1, 2)]
        return torch.cat([intrinsics, bev, cameras.ego_from_cam[:, :3].flatten(1)], dim=1)
