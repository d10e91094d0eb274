"""Affine maps of an image whose camera follows: resize to a width, keep the bottom rows, zoom, flip, rotate."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from coin3d.geometry.camera import Camera


@dataclass(frozen=True, eq=False)
class ImageTransform:
    """A resize followed by an affine map, kept apart because only the resize may need anti-aliasing.

    Args:
        resized: (width, height) in pixels the image is resized to first.
        affine: (3, 3) map from the resized image to the output, in pixel-edge coordinates.
        width_px: output width.
        height_px: output height.
    """

    resized: tuple[int, int]
    affine: Float[np.ndarray, "3 3"]
    width_px: int
    height_px: int

    def pixel_map(self, width_px: int, height_px: int) -> Float[np.ndarray, "3 3"]:
        """The whole (3, 3) map from an input image of that size to the output."""
        return self.affine @ np.diag([self.resized[0] / width_px, self.resized[1] / height_px, 1.0])

    def camera(self, camera: Camera) -> Camera:
        """The camera of the transformed image."""
        return camera.transformed(self.pixel_map(camera.width_px, camera.height_px), self.width_px, self.height_px)

    def image(self, image: UInt8[np.ndarray, "h w 3"], *, averaged: bool = False) -> UInt8[np.ndarray, "H W 3"]:
        """The transformed image; what the input does not cover is black.

        Args:
            image: as the transform expects it, or the same view at another size.
            averaged: it comes from averaging a larger one, and less than a factor of two is left to shrink: linear
                interpolation does, and costs far less.
        """
        shrinks = self.resized[0] < image.shape[1] and not averaged
        out = image
        if self.resized != (image.shape[1], image.shape[0]):
            out = cv2.resize(image, self.resized, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
        shift = self.affine[:2, 2]
        if np.array_equal(self.affine[:2, :2], np.eye(2)) and np.array_equal(shift, np.round(shift)):
            return _shifted(out, int(shift[0]), int(shift[1]), self.width_px, self.height_px)
        # OpenCV puts the centre of the first pixel at 0, we at 0.5
        half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
        matrix = (np.linalg.inv(half) @ self.affine @ half)[:2]
        return np.asarray(cv2.warpAffine(out, matrix, (self.width_px, self.height_px), flags=cv2.INTER_LINEAR))


def _shifted(image: UInt8[np.ndarray, "h w 3"], du: int, dv: int, width_px: int, height_px: int) -> UInt8[np.ndarray, "H W 3"]:
    out = np.zeros((height_px, width_px, 3), dtype=np.uint8)
    u0, v0 = max(du, 0), max(dv, 0)
    u1, v1 = min(du + image.shape[1], width_px), min(dv + image.shape[0], height_px)
    if u1 > u0 and v1 > v0:
        out[v0:v1, u0:u1] = image[v0 - dv : v1 - dv, u0 - du : u1 - du]
    return out


def fit_width(camera: Camera, width_px: int, height_px: int) -> ImageTransform:
    """The paper's image rule: resize to ``width_px``, keep the bottom ``height_px`` rows (spec datasets A).

    An image that is lower than that is padded with black rows at the top.
    """
    resized_height = max(1, round(camera.height_px * width_px / camera.width_px))
    affine = np.eye(3)
    affine[1, 2] = height_px - resized_height
    return ImageTransform((width_px, resized_height), affine, width_px, height_px)


def zoomed(transform: ImageTransform, camera: Camera, ratio: float) -> ImageTransform:
    """Zoom by ``ratio`` about the principal point, before the crop; below 1 a black border remains (paper F-Aug).

    Args:
        transform: what is done to the image without zoom.
        camera: the camera of the untouched image.
        ratio: focal-length factor, > 0.
    """
    if not ratio > 0:
        raise ValueError(f"a zoom ratio is positive, got {ratio}")
    width, height = (max(1, round(side * ratio)) for side in transform.resized)
    scale = np.array([transform.resized[0] / camera.width_px, transform.resized[1] / camera.height_px])
    principal = camera.K[:2, 2] * scale
    grown = principal * np.array([width / transform.resized[0], height / transform.resized[1]])
    shift = np.eye(3)
    shift[:2, 2] = np.round(principal - grown)  # whole pixels: no second interpolation
    return ImageTransform((width, height), transform.affine @ shift, transform.width_px, transform.height_px)


def flipped(transform: ImageTransform) -> ImageTransform:
    """Mirror the output left to right."""
    mirror = np.array([[-1.0, 0, transform.width_px], [0, 1, 0], [0, 0, 1]])
    return ImageTransform(transform.resized, mirror @ transform.affine, transform.width_px, transform.height_px)


def rotated(transform: ImageTransform, angle_rad: float) -> ImageTransform:
    """Turn the output about its centre, clockwise as seen (v points down)."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    cu, cv = transform.width_px / 2, transform.height_px / 2
    turn = np.array([[c, -s, cu - c * cu + s * cv], [s, c, cv - s * cu - c * cv], [0, 0, 1]])
    return ImageTransform(transform.resized, turn @ transform.affine, transform.width_px, transform.height_px)
