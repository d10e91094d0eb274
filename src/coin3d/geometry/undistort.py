"""From a camera with a lens to a pinhole camera that sees the same: which one, and where its pixels come from.

Detectors, priors and the renderer know pinhole cameras only. An image taken through another lens is resampled once, when it
is read, and everything after that is exact.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int16, UInt8, UInt16

from coin3d.geometry.camera import Camera
from coin3d.geometry.lens import Lens, Pinhole
from coin3d.geometry.rig import Rig

MAX_VIEW_DEG = 120.0
"""A pinhole camera that stands in for a fisheye is no wider than this, to each side half of it.

The scale of a pinhole image grows with 1 / cos^2 of the angle to its axis: at 60 degrees it is four times that of the middle,
at 75 degrees fifteen times, and the middle would be left with few pixels."""

_STRIDE_PX = 8
"""Where pixels come from is computed this far apart and is linear between (error: a 20th of a pixel; OpenCV's is a 32nd)."""

_LARGEST_SIDE = 32767
_AT_THE_EDGE_PX = 1e-6


def has_lens(rig: Rig) -> bool:
    """Whether any camera has a lens other than the pinhole."""
    return any(not isinstance(camera.lens, Pinhole) for camera in rig.values())


def pinhole_camera(camera: Camera, max_view_deg: float = MAX_VIEW_DEG) -> Camera:
    """The pinhole camera that stands in for one with a lens; a pinhole camera is returned as it is.

    It has the same pose, image size, principal point and proportion of focal lengths. The focal length is the smallest at
    which every pixel has its origin within the recorded image, so that nothing has to be made up, and at which the image
    reaches no farther than ``max_view_deg / 2`` from the principal point to the left, right, top and bottom.

    Raises:
        ValueError: a principal point outside the image, or a view that is not between 0 and 180 degrees.
    """
    if isinstance(camera.lens, Pinhole):
        return camera
    if not 0 < max_view_deg < 180:
        raise ValueError(f"the view of a pinhole camera is between 0 and 180 degrees, got {max_view_deg:g}")
    zoom = _zoom(camera.K.tobytes(), camera.width_px, camera.height_px, camera.lens, max_view_deg)
    K = camera.K.copy()
    K[:2, :2] *= zoom
    return replace(camera, K=K, lens=Pinhole())


def undistorted_rig(rig: Rig) -> Rig:
    """The rig with ``pinhole_camera`` of each of its cameras; the same object if it has no lenses."""
    return rig.with_cameras({name: pinhole_camera(c) for name, c in rig.items()}) if has_lens(rig) else rig


def source_pixels(camera: Camera, pixels: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "... 2"]:
    """Where pixels of ``pinhole_camera(camera)`` come from in the recorded image; NaN where the lens model ends."""
    plane = camera.lens.plane_from_ray(pinhole_camera(camera).rays_cam(pixels))
    return np.asarray(plane @ camera.K[:2, :2].T + camera.K[:2, 2])


def undistort_image(image: UInt8[np.ndarray, "h w *c"], camera: Camera, reduction: int = 1) -> UInt8[np.ndarray, "h w *c"]:
    """The image ``pinhole_camera(camera)`` would have taken, by linear interpolation.

    Args:
        image: recorded through ``camera``.
        camera: with its lens. Where pixels come from is remembered for the last 16 calibrations, whatever their poses.
        reduction: the image is this many times smaller than the camera's, and so is the result; a divisor of both sides.

    Raises:
        ValueError: the image is not of the camera's size.
    """
    if isinstance(camera.lens, Pinhole):
        return image
    if (image.shape[0] * reduction, image.shape[1] * reduction) != (camera.height_px, camera.width_px):
        raise ValueError(
            f"{image.shape[1] * reduction} x {image.shape[0] * reduction} pixels but the rig says "
            f"{camera.width_px} x {camera.height_px}; "
            "correct 'size' (and K) in the calibration"
        )
    places, weights = _remap_tables(camera.K.tobytes(), camera.width_px, camera.height_px, camera.lens, reduction)
    # the border is repeated because the tables are rounded: no pixel comes from farther out than a fraction of one
    return np.asarray(cv2.remap(image, places, weights, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


@lru_cache(maxsize=4096)
def _zoom(K_bytes: bytes, width_px: int, height_px: int, lens: Lens, max_view_deg: float) -> float:
    """Focal length of the pinhole camera over that of the camera with the lens."""
    K = np.frombuffer(K_bytes).reshape(3, 3)
    middles = np.array([[0, K[1, 2]], [width_px, K[1, 2]], [K[0, 2], 0], [K[0, 2], height_px]])
    reach = np.linalg.norm((middles - K[:2, 2]) @ np.linalg.inv(K[:2, :2]).T, axis=1).max()
    widest = float(reach / np.tan(np.deg2rad(max_view_deg) / 2))
    border = (_border(width_px, height_px) - K[:2, 2]) @ np.linalg.inv(K[:2, :2]).T

    def fits(zoom: float) -> bool:
        rays = np.concatenate([border / zoom, np.ones_like(border[:, :1])], axis=1)
        return bool(_inside(lens.plane_from_ray(rays) @ K[:2, :2].T + K[:2, 2], width_px, height_px).all())

    # what lies inside a closed curve stays inside its image: it is enough to look at the border
    if fits(widest):
        return widest
    low, high = widest, max(2 * widest, 1.0)
    while not fits(high):
        low, high = high, 2 * high
        if high > 1e6:
            raise ValueError(
                f"the principal point ({K[0, 2]:g}, {K[1, 2]:g}) lies outside the image of {width_px} x {height_px} pixels, so "
                "that it cannot be undistorted around it: check K and size"
            )
    while high - low > 1e-9 * high:
        middle = (low + high) / 2
        low, high = (low, middle) if fits(middle) else (middle, high)
    return high


def _border(width_px: int, height_px: int) -> Float[np.ndarray, "n 2"]:
    u, v = np.arange(width_px) + 0.5, np.arange(height_px) + 0.5
    rows = [np.stack([u, np.full_like(u, at)], axis=1) for at in (0.5, height_px - 0.5)]
    columns = [np.stack([np.full_like(v, at), v], axis=1) for at in (0.5, width_px - 0.5)]
    return np.concatenate([*rows, *columns])


def _inside(pixels: Float[np.ndarray, "n 2"], width_px: int, height_px: int) -> Bool[np.ndarray, "n"]:
    """Which places lie between the centres of the outermost pixels."""
    first, last = 0.5 - _AT_THE_EDGE_PX, np.array([width_px, height_px]) - 0.5 + _AT_THE_EDGE_PX
    return np.asarray(((pixels >= first) & (pixels <= last)).all(1))


@lru_cache(maxsize=16)
def _remap_tables(
    K_bytes: bytes, width_px: int, height_px: int, lens: Lens, reduction: int
) -> tuple[Int16[np.ndarray, "h w 2"], UInt16[np.ndarray, "h w"]]:
    """OpenCV's tables of whole pixels and of weights, both for images ``reduction`` times smaller than the camera's."""
    if max(width_px, height_px) > _LARGEST_SIDE:
        raise ValueError(f"an image of {width_px} x {height_px} pixels is too large to be undistorted: shrink it first")
    zoom = _zoom(K_bytes, width_px, height_px, lens, MAX_VIEW_DEG)
    K = np.frombuffer(K_bytes).reshape(3, 3)
    sides = width_px // reduction, height_px // reduction
    nodes = [np.linspace(0.5, side - 0.5, -(-side // _STRIDE_PX) + 1) * reduction for side in sides]
    pixels = np.stack(np.meshgrid(*nodes), axis=-1).reshape(-1, 2)
    plane = (pixels - K[:2, 2]) @ np.linalg.inv(zoom * K[:2, :2]).T
    rays = np.concatenate([plane, np.ones_like(plane[:, :1])], axis=1)
    source = lens.plane_from_ray(rays) @ K[:2, :2].T + K[:2, 2]
    # OpenCV puts the centre of the first pixel at 0, we at 0.5
    coarse = (source / reduction - 0.5).astype(np.float32).reshape(len(nodes[1]), len(nodes[0]), 2)
    u, v = (_between(_between(coarse[..., i].T, sides[0]).T, sides[1]) for i in range(2))
    places, weights = cv2.convertMaps(u, v, cv2.CV_16SC2)
    return np.asarray(places), np.asarray(weights)


def _between(values: Float[np.ndarray, "n m"], count: int) -> Float[np.ndarray, "k m"]:
    """Values at ``count`` evenly spaced places from the first row to the last, linear between rows."""
    at = np.linspace(0, len(values) - 1, count)
    row = np.minimum(at.astype(np.int64), len(values) - 2)
    steps = np.diff(values, axis=0)[row]
    steps *= (at - row).astype(np.float32)[:, None]
    steps += values[row]
    return np.ascontiguousarray(steps)
