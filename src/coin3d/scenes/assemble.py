"""From images with depth and the models to the Gaussians of a key frame (paper sec. 4.2; spec official_code 4, step 4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from coin3d.geometry import Camera, GroundPlane
from coin3d.rendering import Gaussians
from coin3d.scenes.back_layer import BackLayer
from coin3d.scenes.render_depth import BACKGROUND
from coin3d.scenes.seen_view import FROM_SKY, OWN_VEHICLE, SeenView

_TILE = 16
_BACK_PX = 0.5


@dataclass(frozen=True)
class SplatRadii:
    """Standard deviations in metres. The paper writes Sigma = r I; the released scales are standard deviations.

    Args:
        ground_m: of background pixels at ground height.
        high_m: of background pixels at ``high_above_m`` and higher, linear in between.
        high_above_m: 10 in the paper, 5 as released.
        foreground_m: of pixels on objects.
        hidden_m: of inpainted background behind objects.
        blind_m: at least this for the ground that no camera sees.
        least_px: floor in pixels of the image the point comes from.
        most_px: ceiling likewise: 0.02 m of street 4 m away are three pixels at 800 pixels width, a blur that costs
            several dB.
        sky_px: of the sky in pixels; it is even, so it may be wide, and then has no gaps.
    """

    ground_m: float = 0.02
    high_m: float = 0.001
    high_above_m: float = 10.0
    foreground_m: float = 0.0025
    hidden_m: float = 0.001
    blind_m: float = 0.02
    least_px: float = 0.35
    most_px: float = 0.45
    sky_px: float = 0.6

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value >= (0 if name == "least_px" else 1e-6):
                raise ValueError(f"{name} of the radii must be positive, got {value}")
        if self.least_px > self.most_px:
            raise ValueError(f"the radii have a floor of {self.least_px} pixels above the ceiling of {self.most_px}")

    @classmethod
    def paper(cls) -> SplatRadii:
        """As printed, for images 800 pixels wide: no floor, no ceiling."""
        return cls(least_px=0.0, most_px=np.inf)

    @classmethod
    def released(cls) -> SplatRadii:
        """As in the released code, for images 800 pixels wide."""
        return cls(high_above_m=5.0, least_px=0.0, most_px=np.inf)

    def bounded(self, std_m: Float[np.ndarray, "..."], pixel_m: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        """Standard deviations within the bounds in pixels, given the width of a pixel at each point's depth."""
        return np.asarray(np.minimum(np.maximum(std_m, self.least_px * pixel_m), self.most_px * pixel_m))

    def background_m(self, height_m: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        """Standard deviations of background pixels by their height above the ground."""
        share = np.clip(height_m / self.high_above_m, 0, 1)
        return np.asarray(self.ground_m + (self.high_m - self.ground_m) * share)


@dataclass(frozen=True, eq=False)
class ViewGaussians:
    """What one view contributes.

    Args:
        seen: one Gaussian per shown pixel, in 16 x 16 pixel tile order.
        pixel: (n,) row-major pixel number of each of them.
        behind: background behind objects and behind other near edges.
    """

    seen: Gaussians
    pixel: Int[np.ndarray, "n"]
    behind: Gaussians


def view_gaussians(
    view: SeenView, wrong: Bool[np.ndarray, "h w"], layers: Sequence[BackLayer], ground: GroundPlane, radii: SplatRadii
) -> ViewGaussians:
    """The pixels of a view and its back layers as Gaussians.

    The outermost background pixels around an object, whose colours are mixed with it, are left out: the layer behind the
    object has them without it.

    Args:
        view: image with depth.
        wrong: pixels to leave out because other images know better.
        layers: what is behind it; the first one must know the background around objects.
        ground: heights count from here.
        radii: sizes.
    """
    background = view.box == BACKGROUND
    points = _points(view.camera, view.depth_m)
    std = np.where(background, radii.background_m(ground.height_m(points)), radii.foreground_m)
    pixel_m = view.depth_m / view.camera.focal_px
    std = np.where(view.source == FROM_SKY, radii.sky_px * pixel_m, radii.bounded(std, pixel_m))
    mixed = background & _touches(~background)
    order = tile_order(*view.depth_m.shape)
    seen, pixel = _flat(points, std, view.rgb, ~mixed & ~wrong & (view.box != OWN_VEHICLE), order)
    behind = []
    for number, layer in enumerate(layers):
        # it is only ever seen magnified, so it has at least half a pixel
        layer_std = np.maximum(radii.hidden_m, _BACK_PX * layer.depth_m / view.camera.focal_px)
        mask = layer.mask | mixed if number == 0 else layer.mask
        behind.append(_flat(_points(view.camera, layer.depth_m), layer_std, layer.rgb, mask, order)[0])
    return ViewGaussians(seen, pixel, Gaussians.concatenate(behind))


def blind_gaussians(
    points_ego: Float[np.ndarray, "n 3"], rgb: UInt8[np.ndarray, "n 3"], spacing_m: float, radii: SplatRadii
) -> Gaussians:
    """The ground under the vehicle: radius 0.02 m as in the paper, or the spacing where that is wider."""
    std = np.full(len(points_ego), max(radii.blind_m, spacing_m), dtype=np.float32)
    return Gaussians(points_ego.astype(np.float32), std, rgb)


@lru_cache(maxsize=8)
def tile_order(height_px: int, width_px: int) -> Int[np.ndarray, "p"]:
    """Row-major pixel numbers sorted so that the pixels of each 16 x 16 tile follow each other."""
    v, u = np.divmod(np.arange(height_px * width_px), width_px)
    return np.lexsort((u, v, u // _TILE, v // _TILE))


def _points(camera: Camera, depth_m: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w 3"]:
    rays_cam = camera.rays_cam(camera.pixel_grid())
    return camera.ego_from_cam.apply(rays_cam / rays_cam[..., 2:] * depth_m[..., None])


def _flat(
    points: Float[np.ndarray, "h w 3"],
    std: Float[np.ndarray, "h w"],
    rgb: UInt8[np.ndarray, "h w 3"],
    mask: Bool[np.ndarray, "h w"],
    order: Int[np.ndarray, "p"],
) -> tuple[Gaussians, Int[np.ndarray, "n"]]:
    chosen = order[mask.reshape(-1)[order]]
    return Gaussians(
        points.reshape(-1, 3)[chosen].astype(np.float32),
        std.reshape(-1)[chosen].astype(np.float32),
        rgb.reshape(-1, 3)[chosen],
    ), chosen


def _touches(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels with one of the mask to their left, right, top or bottom."""
    out = np.zeros_like(mask)
    out[1:] |= mask[:-1]
    out[:-1] |= mask[1:]
    out[:, 1:] |= mask[:, :-1]
    out[:, :-1] |= mask[:, 1:]
    return out
