"""The cameras of a batch as tensors: what priors, lifting and camera-aware gates read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from coin3d.geometry.camera import Camera
from coin3d.geometry.ground import GroundPlane
from coin3d.geometry.lens import Pinhole


@dataclass(frozen=True, eq=False)
class CameraTensors:
    """M cameras of one image size; rigs of any size are flattened into M.

    Args:
        K: (M, 3, 3) intrinsics in network-input pixels, image augmentation folded in (first pixel centre at 0.5).
        ego_from_cam: (M, 4, 4).
        ground: (M, 4) plane (n_x, n_y, n_z, d) in the un-augmented ego frame: n . p + d = 0.
        height_px: network-input height.
        width_px: network-input width.
    """

    K: Float[Tensor, "m 3 3"]
    ego_from_cam: Float[Tensor, "m 4 4"]
    ground: Float[Tensor, "m 4"]
    height_px: int
    width_px: int

    @classmethod
    def from_cameras(cls, cameras: Sequence[Camera], grounds: Sequence[GroundPlane]) -> CameraTensors:
        """Stack cameras that share an image size, each with the ground plane of its rig (float32).

        Raises:
            ValueError: no cameras, a camera with a lens other than the pinhole, cameras of different image sizes, or another
                number of ground planes.
        """
        if bent := [c.lens for c in cameras if not isinstance(c.lens, Pinhole)]:
            raise ValueError(
                f"a camera batch holds pinhole cameras only, got one with the lens {bent[0]}: undistort its frame first with "
                "coin3d.datasets.undistorted.undistorted(frame); open_recording does so by itself"
            )
        sizes = {(c.height_px, c.width_px) for c in cameras}
        if len(sizes) != 1:
            raise ValueError(f"a camera batch has exactly one image size, got {sorted(sizes)}")
        ((height, width),) = sizes
        if len(grounds) != len(cameras):
            raise ValueError(f"a camera batch needs one ground plane per camera, got {len(grounds)} for {len(cameras)} cameras")
        planes = [[*g.normal, g.offset_m] for g in grounds]
        return cls(
            torch.from_numpy(np.stack([c.K for c in cameras])).float(),
            torch.from_numpy(np.stack([c.ego_from_cam.matrix for c in cameras])).float(),
            torch.tensor(np.asarray(planes), dtype=torch.float32),
            height,
            width,
        )

    def __len__(self) -> int:
        return len(self.K)

    def to(self, device: torch.device | str) -> CameraTensors:
        return CameraTensors(
            self.K.to(device), self.ego_from_cam.to(device), self.ground.to(device), self.height_px, self.width_px
        )

    @property
    def key(self) -> tuple[object, ...]:
        """Equal for equal cameras on the same device: for memories of what depends on cameras alone."""
        numbers = tuple(t.detach().cpu().numpy().tobytes() for t in (self.K, self.ego_from_cam, self.ground))
        return (*numbers, self.height_px, self.width_px, str(self.K.device))

    @property
    def focal_px(self) -> Float[Tensor, "m"]:
        """sqrt(|det K_2x2|): sqrt(fx fy), unchanged by flips and rotations of the image."""
        focal: Tensor = torch.linalg.det(self.K[:, :2, :2].double()).abs().sqrt()
        return focal.to(self.K.dtype)
