"""One camera: intrinsics, image size, lens, and where it sits on the ego vehicle."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float

from coin3d.geometry.lens import Lens, Pinhole
from coin3d.geometry.pose import Pose

MIN_DEPTH_M = 0.5
"""A point nearer to the image plane than this does not count as seen."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A calibrated camera.

    Pixels: the centre of the top-left pixel is (0.5, 0.5), the image spans [0, width] x [0, height].

    Args:
        K: (3, 3) intrinsics in pixels, last row 0 0 1. Flips and rotations of the image are folded in, so the
            upper-left block need not be diagonal and its determinant may be negative.
        width_px: image width.
        height_px: image height.
        ego_from_cam: pose of the camera (x right, y down, z forward) in the ego frame (x forward, y left, z up).
        lens: the lens model, pinhole by default.

    Raises:
        ValueError: singular or non-finite K, a wrong last row, or an image without pixels.
    """

    K: Float[np.ndarray, "3 3"]
    width_px: int
    height_px: int
    ego_from_cam: Pose
    lens: Lens = field(default_factory=Pinhole)

    def __post_init__(self) -> None:
        K = np.array(self.K, dtype=np.float64)
        if K.shape != (3, 3):
            raise ValueError(f"K is a (3, 3) matrix, got shape {K.shape}")
        if not np.isfinite(K).all():
            raise ValueError(f"K holds a number that is not finite: {K.tolist()}")
        if not np.allclose(K[2], (0, 0, 1)):
            raise ValueError(f"the last row of K is 0 0 1, got {K[2].tolist()}: is K transposed?")
        if abs(np.linalg.det(K[:2, :2])) < 1e-6:
            raise ValueError(f"K is singular (focal lengths {K[0, 0]:g}, {K[1, 1]:g}): check the calibration")
        if self.width_px < 1 or self.height_px < 1:
            raise ValueError(f"an image of {self.width_px} x {self.height_px} pixels has no content")
        K.setflags(write=False)
        object.__setattr__(self, "K", K)
        object.__setattr__(self, "width_px", int(self.width_px))
        object.__setattr__(self, "height_px", int(self.height_px))

    @property
    def focal_px(self) -> float:
        """Focal length sqrt(|det K_2x2|): sqrt(fx fy), unchanged by rotating or flipping the image."""
        return float(np.sqrt(abs(np.linalg.det(self.K[:2, :2]))))

    @property
    def height_m(self) -> float:
        """Height of the camera centre above the ego origin."""
        return float(self.ego_from_cam.translation[2])

    @property
    def yaw_rad(self) -> float:
        """Direction of view in the ego xy plane."""
        forward = self.ego_from_cam.rotation[:, 2]
        return float(np.arctan2(forward[1], forward[0]))

    @property
    def fov_horizontal_rad(self) -> float:
        """2 arctan(c_u / f_u), paper eq. fov_calc (supplement); through another lens twice the angle to the left edge."""
        if not isinstance(self.lens, Pinhole):
            return 2 * self._angle_rad(0.0, self.K[1, 2])
        return float(2 * np.arctan(self.K[0, 2] / abs(self.K[0, 0])))

    @property
    def fov_vertical_rad(self) -> float:
        """2 arctan((h - c_v) / f_v), paper eq. fov_calc: the part below the principal point, doubled; so for any lens."""
        if not isinstance(self.lens, Pinhole):
            return 2 * self._angle_rad(self.K[0, 2], float(self.height_px))
        return float(2 * np.arctan((self.height_px - self.K[1, 2]) / abs(self.K[1, 1])))

    def _angle_rad(self, u: float, v: float) -> float:
        """Angle between a pixel's ray and the optical axis; not a number where the lens model ends before it."""
        x, y, z = self.rays_cam(np.array([u, v]))
        return float(np.arctan2(np.hypot(x, y), z))

    def transformed(self, pixel_map: Float[np.ndarray, "3 3"], width_px: int, height_px: int) -> Camera:
        """The camera of an image that was resized, cropped, flipped or rotated by the affine (3, 3) ``pixel_map``."""
        return replace(self, K=np.asarray(pixel_map) @ self.K, width_px=width_px, height_px=height_px)

    def moved(self, ego_from_cam: Pose) -> Camera:
        """The same camera at another place."""
        return replace(self, ego_from_cam=ego_from_cam)

    def project(self, points_ego: Float[np.ndarray, "... 3"]) -> tuple[Float[np.ndarray, "... 2"], Float[np.ndarray, "..."]]:
        """Pixels (u, v) and depth z (metres along the optical axis) of points in the ego frame.

        Pixels of points behind the camera (z <= 0) are NaN, through a fisheye that sees them too: depth along the optical axis
        has no meaning there.
        """
        points_cam = self.ego_from_cam.inverse().apply(points_ego)
        depth_m = points_cam[..., 2]
        safe = np.where((depth_m > 0)[..., None], points_cam, np.nan)
        with np.errstate(invalid="ignore", divide="ignore"):
            plane = self.lens.plane_from_ray(safe)
        return plane @ self.K[:2, :2].T + self.K[:2, 2], depth_m

    def rays_cam(self, pixels: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "... 3"]:
        """Rays through pixels in the camera frame (all but fisheyes: z = 1, so that depth times ray is the point)."""
        plane = (np.asarray(pixels, dtype=np.float64) - self.K[:2, 2]) @ np.linalg.inv(self.K[:2, :2]).T
        return self.lens.ray_from_plane(plane)

    def rays_ego(self, pixels: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "... 3"]:
        """Rays through pixels, turned into ego axes; their common origin is ``ego_from_cam.translation``."""
        return self.ego_from_cam.rotate(self.rays_cam(pixels))

    def pixel_grid(self) -> Float[np.ndarray, "h w 2"]:
        """Centres (u, v) of all pixels."""
        u, v = np.meshgrid(np.arange(self.width_px) + 0.5, np.arange(self.height_px) + 0.5)
        return np.stack([u, v], axis=-1)

    def in_image(self, pixels: Float[np.ndarray, "... 2"], depth_m: Float[np.ndarray, "..."]) -> Bool[np.ndarray, "..."]:
        """Which results of ``project`` fall into the image with depth above ``MIN_DEPTH_M``."""
        with np.errstate(invalid="ignore"):
            inside = (pixels >= 0).all(-1) & (pixels[..., 0] < self.width_px) & (pixels[..., 1] < self.height_px)
        return np.asarray(inside & (depth_m > MIN_DEPTH_M))

    def sees(self, points_ego: Float[np.ndarray, "... 3"]) -> Bool[np.ndarray, "..."]:
        """Whether points fall into the image (occlusion is not considered)."""
        return self.in_image(*self.project(points_ego))
