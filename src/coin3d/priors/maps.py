"""The four spatial prior maps of a camera, in closed form (paper section 4.1; conventions: docs/conventions.md).

Everything here is a function of the camera alone. A pixel (u, v) looks along d = R K^-1 [u, v, 1] (ego axes, one metre of
camera depth per unit), and for a ground plane n . p + c = 0 the *inverse* ground depth

    q(u, v) = 1 / z = -(n . d) / (n . t + c)

is affine in (u, v). That is paper eq. ground_depth without its least-squares fit, and it makes the ground gradient exact
too: with b = dq/dv,  g = z(v - 1) - z(v) = b / (q(v) q(v - 1)),  so  log(1/g + 1) = log1p(q(v) q(v - 1) / b).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import avg_pool2d

from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.priors.channels import GROUND_DEPTH, GROUND_GRADIENT, INVERSE_FOCAL, PLUECKER, PRIOR_CHANNELS

GROUND_DEPTH_SCALE_M = 25.0
"""Ground depth is divided by this (paper supplement, Prior Maps)."""
GROUND_GRADIENT_SCALE = 2.0
"""The log-inverse gradient is divided by this (paper supplement, Prior Maps)."""


@dataclass(frozen=True)
class PriorOptions:
    """The constants of the maps; a checkpoint stores them ``resolved``.

    Args:
        reference_focal_px: focal length at which the inverse focal map is 1; ``None`` means 500 px for an input 704 px
            wide (the paper's) and in proportion for other widths, so that small inputs stay near 1.
        ground_cap_m: ground farther than this counts as no ground.

    Raises:
        ValueError: a constant that is not positive.
    """

    reference_focal_px: float | None = None
    ground_cap_m: float = 60.0

    def __post_init__(self) -> None:
        if self.reference_focal_px is not None and not self.reference_focal_px > 0:
            raise ValueError(f"the reference focal length is positive pixels, got {self.reference_focal_px}")
        if not self.ground_cap_m > 0:
            raise ValueError(f"the cap of the ground depth is positive metres, got {self.ground_cap_m}")

    def resolved(self, width_px: int) -> PriorOptions:
        """The same options with the reference focal length fixed for a network-input width."""
        return replace(self, reference_focal_px=self.focal_for_width_px(width_px))

    def focal_for_width_px(self, width_px: int) -> float:
        return 500.0 * width_px / 704.0 if self.reference_focal_px is None else self.reference_focal_px


def prior_maps(cameras: CameraTensors, options: PriorOptions | None = None) -> Float[Tensor, "m 9 h w"]:
    """The nine prior channels of M cameras at the resolution of their images.

    0 inverse focal (f_ref / f)^2 with f = sqrt |det K_2x2|; 1 ground depth z / 25 m and 2 ground gradient
    log(1 / g + 1) / 2 with g = z(v - 1) - z(v) in metres, both zero where the ray misses the ground or meets it beyond the
    cap (for the gradient: here or one row above, also above the first row); 3-5 direction d; 6-8 moment t x d in metres.
    A camera at or below its ground sees no ground.

    Args:
        cameras: image augmentation folded into K, poses in the un-augmented ego frame.
        options: ``PriorOptions()`` by default.

    Returns:
        float32 on the device of the cameras.
    """
    options = options or PriorOptions()
    maps = empty_maps(cameras)
    f_ref = options.focal_for_width_px(cameras.width_px)
    maps[:, INVERSE_FOCAL] = ((f_ref / cameras.focal_px) ** 2)[:, None, None]
    fill_ground(maps, cameras, options.ground_cap_m)
    ego_from_pixel = rays_from_pixels(cameras)
    origin = cameras.ego_from_cam[:, :3, 3].double()
    fill_affine(maps[:, PLUECKER], torch.cat([ego_from_pixel, cross_columns(origin, ego_from_pixel)], dim=1), 0.5)
    return maps


def downsample(maps: Float[Tensor, "m 9 h w"], stride: int) -> Float[Tensor, "m 9 h2 w2"]:
    """Means over blocks of stride x stride pixels; the ground maps average their valid (non-zero) pixels, 0 if none.

    Blocks cut by the right and lower edge average what they have, so that the size is that of a strided convolution.
    """
    if stride == 1:
        return maps
    pooled = _block_means(maps, stride)
    ground = slice(GROUND_DEPTH, GROUND_GRADIENT + 1)
    valid = _block_means((maps[:, ground] != 0).to(maps.dtype), stride)
    pooled[:, ground] = torch.where(valid > 0, pooled[:, ground] / valid.clamp_min(1e-12), 0.0)
    return pooled


def _block_means(maps: Float[Tensor, "m c h w"], stride: int) -> Float[Tensor, "m c h2 w2"]:
    # one axis after the other: the same mean, but sums of few terms, so that float32 keeps six digits
    rows = avg_pool2d(maps, (1, stride), ceil_mode=True)
    return avg_pool2d(rows, (stride, 1), ceil_mode=True)


def empty_maps(cameras: CameraTensors) -> Float[Tensor, "m 9 h w"]:
    """Uninitialised float32 maps for the cameras."""
    shape = (len(cameras), PRIOR_CHANNELS, cameras.height_px, cameras.width_px)
    return torch.empty(shape, dtype=torch.float32, device=cameras.K.device)


def rays_from_pixels(cameras: CameraTensors) -> Float[Tensor, "m 3 3"]:
    """R K^-1 in float64: maps [u, v, 1] to the ray in ego axes with unit camera depth."""
    ego_from_pixel: Tensor = cameras.ego_from_cam[:, :3, :3].double() @ torch.linalg.inv(cameras.K.double())
    return ego_from_pixel


def cross_columns(origin: Float[Tensor, "m 3"], rays: Float[Tensor, "m 3 3"]) -> Float[Tensor, "m 3 3"]:
    """The matrix of [u, v, 1] -> origin x (rays [u, v, 1])."""
    moment_from_pixel: Tensor = torch.linalg.cross(origin[:, :, None].expand_as(rays), rays, dim=1)
    return moment_from_pixel


def fill_affine(out: Float[Tensor, "m c h w"], maps_from_pixel: Float[Tensor, "m c 3"], first_pixel: float) -> None:
    """Evaluate ``maps_from_pixel @ [u, v, 1]`` at all pixels; u and v start at ``first_pixel``."""
    height, width = out.shape[-2:]
    u = torch.arange(width, device=out.device, dtype=torch.float64) + first_pixel
    v = torch.arange(height, device=out.device, dtype=torch.float64) + first_pixel
    a, b, c = maps_from_pixel.unbind(-1)
    row = (a[..., None] * u).to(out.dtype)
    column = (b[..., None] * v + c[..., None]).to(out.dtype)
    torch.add(row[..., None, :], column[..., :, None], out=out)


def fill_ground(maps: Float[Tensor, "m 9 h w"], cameras: CameraTensors, cap_m: float, first_pixel: float = 0.5) -> None:
    """Write ground depth and ground gradient (see the head of this file) into their channels.

    The inverse depth is evaluated in float64: near the horizon it is the small difference of large terms, and single
    pixels would otherwise appear or vanish at the cap.
    """
    normal, offset = cameras.ground[:, :3].double(), cameras.ground[:, 3].double()
    height_m = (normal * cameras.ego_from_cam[:, :3, 3].double()).sum(1) + offset
    above = height_m > 0
    slope = -torch.einsum("mi,mij->mj", normal, rays_from_pixels(cameras)) / torch.where(above, height_m, 1.0)[:, None]
    slope = slope * above[:, None]
    shape = (len(cameras), 1, cameras.height_px, cameras.width_px)
    inverse = torch.empty(shape, dtype=torch.float64, device=maps.device)
    fill_affine(inverse, slope[:, None], first_pixel)
    q, per_row = inverse[:, 0], slope[:, 1, None, None]
    on_ground = q >= 1 / cap_m
    on_ground_above = (q - per_row >= 1 / cap_m) & on_ground & (per_row > 0)
    # from here on relative errors no longer grow, so float32 is enough
    near, nearer = q.float(), (q - per_row).float()
    maps[:, GROUND_DEPTH] = torch.where(on_ground, 1 / (near * GROUND_DEPTH_SCALE_M), 0.0)
    growth = torch.log1p(near * nearer / per_row.float()) / GROUND_GRADIENT_SCALE
    maps[:, GROUND_GRADIENT] = torch.where(on_ground_above, growth, 0.0)
