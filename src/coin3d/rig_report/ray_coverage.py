"""Where training cameras looked, and from where: the Plücker prior as geometry, free of the pixel that carries a ray."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree

from coin3d.geometry import Camera
from coin3d.rig_report.training_views import SeenView

_BORDER_STEP_PX = 4.0


def sees_direction(camera: Camera, directions: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
    """Whether points at infinity in these directions (ego axes) lie in the image."""
    in_cam = directions @ camera.ego_from_cam.rotation
    ahead = in_cam[:, 2] > 1e-6
    plane = in_cam[:, :2] / np.where(ahead, in_cam[:, 2], 1.0)[:, None]
    pixels = plane @ camera.K[:2, :2].T + camera.K[:2, 2]
    inside = (pixels >= 0).all(1) & (pixels[:, 0] <= camera.width_px) & (pixels[:, 1] <= camera.height_px)
    return np.asarray(ahead & inside)


class RayCoverage:
    """Rays of training cameras, to ask rays of another camera how far they are from them.

    Only views whose whole image shows something count: black borders have directions, but nothing was seen there.
    """

    def __init__(self, views: Sequence[SeenView]) -> None:
        self._cameras = [view.camera for view in views if view.filled]
        self._border = cKDTree(np.concatenate([_border_rays(camera) for camera in self._cameras]))

    def distances(
        self, directions: Float[np.ndarray, "n 3"], origin_ego: Float[np.ndarray, "3"]
    ) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
        """How far rays from one point are from rays of training.

        Args:
            directions: unit vectors, ego axes.
            origin_ego: where they start, in metres.

        Returns:
            The angle in degrees to the nearest direction in which a training camera looked, 0 within an image of one (beyond,
            to the nearest of rays 4 pixels apart along image borders). And the distance in metres between the ray and the
            parallel ray of the nearest training camera that looked there, |(t - t_k) x d|, which is the length of the
            difference of their Plücker moments for d of length 1; NaN where none looked.
        """
        offset_m = np.full(len(directions), np.inf)
        for camera in self._cameras:
            seen = sees_direction(camera, directions)
            if seen.any():
                apart = np.cross(origin_ego - camera.ego_from_cam.translation, directions[seen])
                offset_m[seen] = np.minimum(offset_m[seen], np.linalg.norm(apart, axis=1))
        angle_deg = np.zeros(len(directions))
        unseen = np.isinf(offset_m)
        if unseen.any():
            chord, _ = self._border.query(directions[unseen])
            angle_deg[unseen] = np.rad2deg(2 * np.arcsin(np.clip(chord / 2, 0, 1)))
        return angle_deg, np.where(unseen, np.nan, offset_m)


def _border_rays(camera: Camera) -> Float[np.ndarray, "n 3"]:
    """Unit rays along the image border, ego axes."""
    width, height = float(camera.width_px), float(camera.height_px)
    u = np.linspace(0, width, max(2, int(width / _BORDER_STEP_PX) + 1))
    v = np.linspace(0, height, max(2, int(height / _BORDER_STEP_PX) + 1))
    sides = [(u, 0 * u), (u, 0 * u + height), (0 * v, v), (0 * v + width, v)]
    rays = camera.rays_ego(np.concatenate([np.stack(side, axis=-1) for side in sides]))
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))
