"""The images of a key frame at the size a scene is built at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8

from coin3d.datasets.frame import Frame
from coin3d.geometry import Camera, fit_width

PAPER_WIDTH_PX = 800
"""Width of the images that the paper builds its Gaussians from; its radii and spacings are meant for it."""


@dataclass(frozen=True, eq=False)
class View:
    """One image and its camera, both at building size.

    Args:
        name: of the camera in its rig.
        camera: in the ego frame of the key frame.
        rgb: (h, w, 3).
        own_vehicle: (h, w) pixels that show the vehicle itself.
    """

    name: str
    camera: Camera
    rgb: UInt8[np.ndarray, "h w 3"]
    own_vehicle: Bool[np.ndarray, "h w"]


def load_views(frame: Frame, width_px: int = PAPER_WIDTH_PX) -> list[View]:
    """All images of a frame, shrunk to ``width_px`` where they are wider (never enlarged), in the order of the rig."""
    return [
        View(name, shrink(camera, width_px), _image(frame, name, camera, width_px), _own_vehicle(frame, name, camera, width_px))
        for name, camera in frame.rig.items()
    ]


def shrink(camera: Camera, width_px: int) -> Camera:
    """The camera of the shrunk image."""
    return fit_width(camera, *_size(camera, width_px)).camera(camera)


def pixel_rays_ego(camera: Camera) -> Float[np.ndarray, "h w 3"]:
    """Rays through all pixel centres in ego axes, so long that depth (along the optical axis) times ray is the point."""
    rays_cam = camera.rays_cam(camera.pixel_grid())
    return camera.ego_from_cam.rotate(rays_cam / rays_cam[..., 2:])


def _image(frame: Frame, name: str, camera: Camera, width_px: int) -> UInt8[np.ndarray, "h w 3"]:
    size_px = _size(camera, width_px)
    return fit_width(camera, *size_px).image(frame.image(name, at_least_px=size_px))


def _own_vehicle(frame: Frame, name: str, camera: Camera, width_px: int) -> Bool[np.ndarray, "h w"]:
    """Also pixels that show it in part."""
    mask = frame.own_vehicle_mask(name).astype(np.uint8) * 255
    return fit_width(camera, *_size(camera, width_px)).image(np.repeat(mask[..., None], 3, axis=2))[..., 0] > 0


def _size(camera: Camera, width_px: int) -> tuple[int, int]:
    width = min(width_px, camera.width_px)
    return width, max(1, round(camera.height_px * width / camera.width_px))
