"""Where an image cell looks, as an embedding: points along its ray in the frame of the boxes (PETR; spec detectors 3.4)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from coin3d.detectors.camera_seats import camera_seats
from coin3d.detectors.space_range import SpaceRange, inverse_sigmoid
from coin3d.geometry.camera_tensors import CameraTensors

_SINE_CHANNELS = 128
_TEMPERATURE = 10_000.0
_HIDDEN_PER_CHANNEL = 4


@dataclass(frozen=True)
class RayPoints:
    """Points along each ray, their spacing growing linearly with depth.

    Args:
        count: points per ray.
        first_m: depth of the first.
        last_m: depth at which a further point would lie.
    """

    count: int = 64
    first_m: float = 1.0
    last_m: float = 61.2

    def __post_init__(self) -> None:
        if self.count < 1 or not 0 < self.first_m < self.last_m:
            raise ValueError(f"points on a ray need a positive count and 0 < first < last, got {self}")

    def depths_m(self, like: Tensor) -> Float[Tensor, "d"]:
        k = torch.arange(self.count, device=like.device, dtype=like.dtype)
        return self.first_m + (self.last_m - self.first_m) / (self.count * (self.count + 1)) * k * (k + 1)


class PositionEmbedding3D(nn.Module):
    """Points along the ray of every image cell -> 0..1 within a range -> logits -> two-layer network.

    It sees a camera through its matrices alone: number and order of the cameras leave no trace.

    Args:
        channels: of the embedding.
        stride: pixels per cell.
        rays: the points.
        space: range of space, in the frame of the boxes.
        point_in_cell_px: the pixel of a cell whose ray is taken, from the upper left corner; the centre by default.
    """

    def __init__(
        self, channels: int, stride: int, rays: RayPoints, space: SpaceRange, point_in_cell_px: float | None = None
    ) -> None:
        super().__init__()
        self.stride, self.rays, self.space = stride, rays, space
        self.point_in_cell_px = stride / 2 if point_in_cell_px is None else point_in_cell_px
        self.mlp = _mlp(3 * rays.count, channels)

    def forward(self, cameras: CameraTensors, target_from_ego: Float[Tensor, "m 4 4"]) -> Float[Tensor, "m c h w"]:
        """Embedding of M cameras.

        Args:
            cameras: the cameras of the network images.
            target_from_ego: (M, 4, 4) affine map to the frame of the boxes, BEV augmentation included.
        """
        with torch.autocast(cameras.K.device.type, enabled=False):  # in half precision points would move by metres
            unit = self.space.normalise(self.points_m(cameras, target_from_ego))
            logits = inverse_sigmoid(unit).flatten(3).permute(0, 3, 1, 2)
        out: Tensor = self.mlp(logits)
        return out

    def points_m(self, cameras: CameraTensors, target_from_ego: Float[Tensor, "m 4 4"]) -> Float[Tensor, "m h w d 3"]:
        """The points, metres in the frame of the boxes."""
        K, h, w = cameras.K.double(), cameras.height_px // self.stride, cameras.width_px // self.stride
        rows, columns = (torch.arange(n, device=K.device, dtype=K.dtype) * self.stride + self.point_in_cell_px for n in (h, w))
        v, u = torch.meshgrid(rows, columns, indexing="ij")
        pixels = torch.stack([u, v, torch.ones_like(u)], dim=-1)
        target_from_cam = target_from_ego.double() @ cameras.ego_from_cam.double()
        direction = torch.einsum("mij,hwj->mhwi", target_from_cam[:, :3, :3] @ torch.linalg.inv(K), pixels).float()
        origin = target_from_cam[:, :3, 3].float()
        return origin[:, None, None, None] + direction[:, :, :, None] * self.rays.depths_m(origin)[:, None]


class CameraSineEmbedding(nn.Module):
    """Sine code of (camera, row, column), each counted from 1 as a share of its number, then a two-layer network.

    For released weights: their author advises against it for rigs they were not trained on (spec detectors 3).

    Args:
        channels: of the embedding.
        headings_deg: where the cameras look that are told apart, in their order.
    """

    def __init__(self, channels: int, headings_deg: tuple[float, ...]) -> None:
        super().__init__()
        self.headings_deg = headings_deg
        self.mlp = _mlp(3 * _SINE_CHANNELS, channels)

    def forward(self, ego_from_cam: Float[Tensor, "m 4 4"], h: int, w: int) -> Float[Tensor, "m c h w"]:
        """Embedding of M cameras with feature maps of h rows and w columns."""
        camera = (camera_seats(ego_from_cam, self.headings_deg) + 1) / len(self.headings_deg)
        row, column = ((torch.arange(n, device=camera.device) + 1) / n for n in (h, w))
        shape = len(camera), h, w, _SINE_CHANNELS
        codes = [
            sine_code(camera)[:, None, None].expand(shape),
            sine_code(row)[None, :, None].expand(shape),
            sine_code(column)[None, None].expand(shape),
        ]
        out: Tensor = self.mlp(torch.cat(codes, dim=-1).permute(0, 3, 1, 2))
        return out


def sine_code(share: Float[Tensor, "..."]) -> Float[Tensor, "... 128"]:
    """Sines and cosines, alternating, of a number in 0..1 taken as a share of a full turn, at falling frequencies."""
    pair = torch.arange(_SINE_CHANNELS // 2, device=share.device, dtype=share.dtype)
    angle = share[..., None] * (2 * math.pi) / _TEMPERATURE ** (2 * pair / _SINE_CHANNELS)
    return torch.stack([angle.sin(), angle.cos()], dim=-1).flatten(-2)


def _mlp(inputs: int, outputs: int) -> nn.Sequential:
    hidden = _HIDDEN_PER_CHANNEL * outputs
    return nn.Sequential(nn.Conv2d(inputs, hidden, 1), nn.ReLU(inplace=True), nn.Conv2d(hidden, outputs, 1))
