"""Where the pillars over bird's-eye-view cells appear in the cameras."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from coin3d.detectors.lift_splat import BevGrid
from coin3d.geometry.camera_tensors import CameraTensors

_MIN_DEPTH_M = 1e-5


@dataclass(frozen=True, eq=False)
class PillarViews:
    """Anchors of Q pillars in M cameras.

    Args:
        references: (M, Q, D, 2) as (x, y), 0 and 1 being the edges of the image; far outside for anchors behind the camera.
        visible: (M, Q, D) whether the anchor falls into the image.
    """

    references: Float[Tensor, "m q d 2"]
    visible: Bool[Tensor, "m q d"]


def cell_centres(grid: BevGrid, device: torch.device | str = "cpu") -> Float[Tensor, "q 2"]:
    """(x, y) of each cell from 0 to 1 over the grid; row by row, rows along y."""
    along = torch.linspace(0.5, grid.side - 0.5, grid.side, device=device) / grid.side
    y, x = torch.meshgrid(along, along, indexing="ij")
    return torch.stack([x, y], dim=-1).reshape(-1, 2)


def pillar_anchors(grid: BevGrid, heights_m: tuple[float, ...], device: torch.device | str = "cpu") -> Float[Tensor, "q d 3"]:
    """Points of the BEV frame (metres) on the pillar over each cell."""
    plane = cell_centres(grid, device) * (2 * grid.half_extent_m) - grid.half_extent_m
    z = torch.tensor(heights_m, device=device)
    return torch.cat([plane[:, None].expand(-1, len(z), -1), z[None, :, None].expand(len(plane), -1, 1)], dim=-1)


def image_from_bev(
    cameras: CameraTensors, bev_from_ego: Float[Tensor, "b 4 4"], sample_index: Int[Tensor, "m"], first_pixel: float = 0.5
) -> Float[Tensor, "m 3 4"]:
    """Projection of points of the BEV frame to homogeneous pixels (float64).

    Args:
        cameras: the M cameras.
        bev_from_ego: of each sample.
        sample_index: sample of each camera.
        first_pixel: coordinate the network takes for the centre of the first pixel; 0.5 but for released weights.
    """
    shift = torch.eye(3, dtype=torch.float64, device=cameras.K.device)
    shift[:2, 2] = first_pixel - 0.5
    cam_from_ego = torch.linalg.inv(cameras.ego_from_cam.double())
    cam_from_bev = cam_from_ego @ torch.linalg.inv(bev_from_ego.double())[sample_index]
    projection: Tensor = shift @ cameras.K.double() @ cam_from_bev[:, :3]
    return projection


def project_pillars(
    anchors: Float[Tensor, "q d 3"], projection: Float[Tensor, "m 3 4"], size_px: tuple[int, int]
) -> PillarViews:
    """Project anchors of the BEV frame into cameras with images of ``size_px`` (height, width)."""
    with torch.autocast(anchors.device.type, enabled=False):  # half precision would move anchors by many pixels
        projection = projection.to(anchors.dtype)
        pixels = torch.einsum("mij,qdj->mqdi", projection[:, :, :3], anchors) + projection[:, None, None, :, 3]
        depth_m = pixels[..., 2:]
        size = torch.tensor([size_px[1], size_px[0]], device=anchors.device, dtype=anchors.dtype)
        references = pixels[..., :2] / depth_m.clamp(min=_MIN_DEPTH_M) / size
    inside = ((references > 0) & (references < 1)).all(-1)
    return PillarViews(references, inside & (depth_m[..., 0] > _MIN_DEPTH_M))
