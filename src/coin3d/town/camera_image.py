"""What a camera sees: colour, depth and who is in every pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8

from coin3d.geometry import Camera, Pose
from coin3d.town.raycast import Moment
from coin3d.town.shading import ContactShade, developed, shade

_EDGE = 10
"""Neighbouring 8-bit values that differ by more get four rays per pixel."""


@dataclass(frozen=True, eq=False)
class View:
    """A rendered image.

    Args:
        image: (h, w, 3) RGB.
        depth_m: (h, w) metres along the optical axis at pixel centres, 0 for the sky.
        actor: (h, w) number of the road user at pixel centres, 0 for none.
    """

    image: UInt8[np.ndarray, "h w 3"]
    depth_m: Float[np.ndarray, "h w"]
    actor: Int[np.ndarray, "h w"]


def render_camera(
    moment: Moment,
    camera: Camera,
    world_from_ego: Pose | None = None,
    *,
    contact: ContactShade | None = None,
    smooth_edges: bool = True,
) -> View:
    """Ray-cast one camera.

    Args:
        moment: ``Tracer(world).at(time_s)``.
        camera: any lens; rays go through ``camera.rays_ego``.
        world_from_ego: ego pose, by default the town's own at that time.
        contact: reuse it between the cameras of a rig.
        smooth_edges: average four rays in pixels that differ from a neighbour.
    """
    world_from_ego = world_from_ego or moment.world.world_from_ego(moment.time_s)
    contact = contact or ContactShade(moment, world_from_ego.translation[:2])
    world_from_cam = world_from_ego @ camera.ego_from_cam
    h, w = camera.height_px, camera.width_px
    pixels = camera.pixel_grid().reshape(-1, 2)

    rays_cam = camera.rays_cam(pixels)
    rays = world_from_cam.rotate(rays_cam).astype(np.float32)
    origin = world_from_cam.translation
    origins = np.broadcast_to(origin.astype(np.float32), rays.shape)
    hits = moment.cast(origins, rays)
    pixel_rad = 1.0 / camera.focal_px
    exposure = moment.world.sky.exposure
    image = developed(shade(moment, contact, origin, rays, hits, pixel_rad), exposure)
    if smooth_edges:
        edges = np.flatnonzero(_edges(image.reshape(h, w, 3)))
        if len(edges):
            image[edges] = _finer(moment, contact, camera, world_from_cam, pixels[edges], exposure)
    sky = hits.face < 0
    depth = np.where(sky, 0, hits.distance * rays_cam[:, 2].astype(np.float32))
    actor = np.where(sky, 0, moment.actor[np.maximum(hits.face, 0)])
    return View(image.reshape(h, w, 3), depth.reshape(h, w).astype(np.float32), actor.reshape(h, w).astype(np.int32))


def _edges(image: UInt8[np.ndarray, "h w 3"]) -> np.ndarray:
    grey = image[..., 1].astype(np.int16)
    edge = np.zeros(grey.shape, dtype=bool)
    across = np.abs(np.diff(grey, axis=1)) > _EDGE
    down = np.abs(np.diff(grey, axis=0)) > _EDGE
    edge[:, 1:] |= across
    edge[:, :-1] |= across
    edge[1:] |= down
    edge[:-1] |= down
    return edge


def _finer(
    moment: Moment,
    contact: ContactShade,
    camera: Camera,
    world_from_cam: Pose,
    pixels: Float[np.ndarray, "n 2"],
    exposure: float,
) -> UInt8[np.ndarray, "n 3"]:
    """Mean of four rays on a turned grid inside each pixel."""
    offsets = np.array([[0.125, 0.375], [0.375, -0.125], [-0.125, -0.375], [-0.375, 0.125]])
    spread = (pixels[None] + offsets[:, None]).reshape(-1, 2)
    rays = world_from_cam.rotate(camera.rays_cam(spread)).astype(np.float32)
    hits = moment.cast(np.broadcast_to(world_from_cam.translation.astype(np.float32), rays.shape), rays)
    colours = developed(shade(moment, contact, world_from_cam.translation, rays, hits, 0.5 / camera.focal_px), exposure)
    return np.asarray(((colours.reshape(4, -1, 3).astype(np.uint16).sum(0) + 2) // 4).astype(np.uint8))
