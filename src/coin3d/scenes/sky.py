"""Where an image shows the sky: no mesh knows, so brightness, evenness and place decide, conservatively."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from coin3d.geometry import Camera, GroundPlane
from coin3d.scenes.views import pixel_rays_ego

SKY_DEPTH_M = 150.0
"""Where the sky is put: beyond every surface, near enough that a rig moved by a metre sees it unmoved."""

_MIN_BRIGHTNESS = 90.0
_MAX_GRADIENT = 6.0  # grey values per pixel
_MAX_REDDER = 6.0
_MAX_WALL_SHARE = 0.4
_MIN_SHARE = 0.01
_SAME_COLOUR = 20.0
_RING_GAP_SHARE = 0.06


def find_sky(
    rgb: UInt8[np.ndarray, "h w 3"], depth_m: Float[np.ndarray, "h w"], camera: Camera, ground: GroundPlane
) -> Bool[np.ndarray, "h w"]:
    """Pixels of the sky.

    They lie above the horizon, are not between rows of known depth, are bright, even and not reddish, and hang together
    with the top of the image. An even bright wall or window would pass too, so a region is refused where it runs without
    an edge into a known surface below, and a small one where its colour is not that of a large one. Dark skies (night)
    are never found; their depth is then that of what stands around.

    Args:
        rgb: the image.
        depth_m: known depth, 0 where unknown.
        camera: of the image.
        ground: plane whose horizon counts.
    """
    rising = pixel_rays_ego(camera) @ ground.normal > 0
    smooth = cv2.GaussianBlur(rgb, (0, 0), 1.0).astype(np.float32)
    grey = smooth.mean(axis=2)
    gradient = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1)) / 8
    even = gradient < _MAX_GRADIENT
    bluish = smooth[..., 0] - smooth[..., 2] < _MAX_REDDER
    known = depth_m > 0
    # LiDAR rings on a wall leave rows between them
    gap = 2 * round(camera.height_px * _RING_GAP_SHARE / 2) + 1
    closed = cv2.morphologyEx(known.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((gap, 3), dtype=np.uint8)) > 0
    open_bright = rising & ~closed & (grey > _MIN_BRIGHTNESS) & bluish
    candidate = open_bright & even
    _, region = cv2.connectedComponents(candidate.astype(np.uint8), connectivity=4)
    regions = [region == label for label in np.unique(region[0][candidate[0]])]
    large = [r for r in regions if r.mean() > _MIN_SHARE and not _runs_into_surface(r, known, even)]
    if not large:
        return np.zeros_like(candidate)
    sky = np.logical_or.reduce(large)
    colour = smooth[sky].mean(0)
    for small in regions:
        if small.mean() <= _MIN_SHARE and np.abs(smooth[small].mean(0) - colour).max() < _SAME_COLOUR:
            sky |= small
    return _with_rim(sky, open_bright)


def _runs_into_surface(region: Bool[np.ndarray, "h w"], known: Bool[np.ndarray, "h w"], even: Bool[np.ndarray, "h w"]) -> bool:
    """Whether most columns of a region end at a known surface without an edge in between."""
    height = region.shape[0]
    columns = np.flatnonzero(region.any(0))
    lowest = height - 1 - np.argmax(region[::-1, columns], axis=0)
    walls = np.zeros(len(columns), dtype=bool)
    smooth_so_far = np.ones(len(columns), dtype=bool)
    for step in (1, 2, 3):
        below = np.minimum(lowest + step, height - 1)
        smooth_so_far &= even[below, columns]
        walls |= smooth_so_far & known[below, columns]
    return bool(walls.mean() > _MAX_WALL_SHARE)


def _with_rim(sky: Bool[np.ndarray, "h w"], allowed: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """The region grown by two pixels into what may be sky: its rim was taken for an edge."""
    grown = cv2.dilate(sky.astype(np.uint8), np.ones((5, 5), dtype=np.uint8)) > 0
    return np.asarray(sky | (grown & allowed))
