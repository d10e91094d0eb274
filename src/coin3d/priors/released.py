"""The prior maps exactly as the authors' released code computes them, for converted weights and parity tests only.

Models trained by this project use ``maps.prior_maps``. The differences, all of them in this file: pixels are whole numbers
without the half (u = 0..W-1), the focal length is fx alone, the gradient of the first row is zero, the car-only weights
cross an origin in camera axes with a direction in ego axes, and training may turn the ego frame front to back.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.priors.channels import GROUND_GRADIENT, INVERSE_FOCAL, PLUECKER
from coin3d.priors.maps import cross_columns, empty_maps, fill_affine, fill_ground, rays_from_pixels


@dataclass(frozen=True)
class ReleasedConventions:
    """The released code's conventions: for the prior maps, and for what goes into the network.

    Args:
        moment: ``ego_in_cam`` for the car-only weights (ego origin in camera axes x direction in ego axes: mixed frames),
            ``cam_in_ego`` for the three-class and mixed weights (the paper's t x d).
        reference_focal_px: focal length at which the inverse focal map is 1, whatever the input width.
        ground_cap_m: ground farther than this counts as no ground.
        first_pixel: coordinate of the centre of the first pixel.
        turned_frame_x_m: where on the x axis of the ego the front/back turned frame of training sits.
        swapped_images: blue comes first, normalised as if it were red (Megvii's).
    """

    moment: Literal["ego_in_cam", "cam_in_ego"] = "ego_in_cam"
    reference_focal_px: float = 500.0
    ground_cap_m: float = 60.0
    first_pixel: float = 0.0
    turned_frame_x_m: float = 1.6
    swapped_images: bool = False


def released_maps(
    K: Float[Tensor, "m 3 3"],
    ego_from_cam: Float[Tensor, "m 4 4"],
    post_rotation: Float[Tensor, "m 3 3"],
    post_translation: Float[Tensor, "m 3"],
    size_px: tuple[int, int],
    conventions: ReleasedConventions | None = None,
    turned: bool = False,
) -> Float[Tensor, "m 9 h w"]:
    """The nine channels of the released code; the ground is z = 0.

    Args:
        K: intrinsics before image augmentation beyond resize and crop, for pixel centres at whole numbers.
        ego_from_cam: ``sensor2ego`` of the released code.
        post_rotation: linear part of the image augmentation.
        post_translation: its shift.
        size_px: network-input height and width.
        conventions: ``ReleasedConventions()`` by default.
        turned: the Pluecker maps see an ego frame turned front to back (drawn at random in its training).
    """
    augmentation = post_rotation.double().clone()
    augmentation[:, :, 2] += post_translation.double()
    zoom = torch.linalg.matrix_norm(post_rotation[:, :2, :2].double(), ord=2)
    focal_px = K[:, 0, 0] * zoom
    return _maps(augmentation @ K.double(), focal_px, ego_from_cam, size_px, conventions or ReleasedConventions(), turned)


def released_prior_maps(cameras: CameraTensors, conventions: ReleasedConventions) -> Float[Tensor, "m 9 h w"]:
    """The same nine channels from this project's cameras, whose first pixel has its centre at a half.

    The focal length is the length of the first column of K, which is fx times the zoom of any image augmentation that
    turns, mirrors and scales evenly.
    """
    K = from_whole_pixels(cameras.K)
    focal_px = torch.linalg.vector_norm(K[:, :2, 0], dim=1)
    maps = _maps(K, focal_px, cameras.ego_from_cam, (cameras.height_px, cameras.width_px), conventions, turned=False)
    return maps.to(cameras.K.dtype)


def from_whole_pixels(K: Float[Tensor, "m 3 3"]) -> Float[Tensor, "m 3 3"]:
    """Intrinsics for pixel centres at whole numbers, from ours."""
    shift = torch.eye(3, dtype=torch.float64, device=K.device)
    shift[:2, 2] = -0.5
    return shift @ K.double()


def _maps(
    K: Float[Tensor, "m 3 3"],
    focal_px: Float[Tensor, "m"],
    ego_from_cam: Float[Tensor, "m 4 4"],
    size_px: tuple[int, int],
    conventions: ReleasedConventions,
    turned: bool,
) -> Float[Tensor, "m 9 h w"]:
    ground = torch.tensor([0.0, 0.0, 1.0, 0.0], device=K.device).expand(len(K), 4)
    cameras = CameraTensors(K, ego_from_cam.double(), ground, *size_px)
    maps = empty_maps(cameras)
    maps[:, INVERSE_FOCAL] = ((conventions.reference_focal_px / focal_px) ** 2)[:, None, None]
    fill_ground(maps, cameras, conventions.ground_cap_m, conventions.first_pixel)
    maps[:, GROUND_GRADIENT, 0] = 0.0

    ego_pose = cameras.ego_from_cam
    if turned:
        ego_pose = _turned_from_ego(conventions.turned_frame_x_m, ego_pose) @ ego_pose
    rays = rays_from_pixels(CameraTensors(cameras.K, ego_pose, ground, *size_px))
    origin = ego_pose[:, :3, 3] if conventions.moment == "cam_in_ego" else torch.linalg.inv(ego_pose)[:, :3, 3]
    fill_affine(maps[:, PLUECKER], torch.cat([rays, cross_columns(origin, rays)], dim=1), conventions.first_pixel)
    return maps


def _turned_from_ego(x_m: float, like: Float[Tensor, "m 4 4"]) -> Float[Tensor, "4 4"]:
    # a half turn is its own inverse: p' = (x_m - x, -y, z)
    turn = torch.diag(torch.tensor([-1.0, -1.0, 1.0, 1.0]))
    turn[0, 3] = x_m
    return turn.to(like)
