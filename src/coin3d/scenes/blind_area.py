"""The ground around the vehicle that no camera sees, with colours from other frames (spec official_code 4, step 3.4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from scipy.spatial import ConvexHull, KDTree, QhullError

from coin3d.datasets.frame import Frame
from coin3d.geometry import GroundPlane, Rig
from coin3d.scenes.colour_lookup import NearestColours, look_up
from coin3d.scenes.render_depth import BACKGROUND, FrameSurfaces
from coin3d.scenes.seen_view import FROM_SKY, SeenView

MIN_EGO_MOTION_M = 0.25
AGREEMENT_M = 0.1
AGREEMENT_SHARE = 0.02
_REACH_M = 12.0
_NEAR_GROUND_M = 0.3
_NEAREST = 6
_EVEN_WITHIN_M = 0.05
_TILE = 16


@dataclass(frozen=True, eq=False)
class Neighbour:
    """Another key frame of the same scene.

    Args:
        frame: the frame.
        views: its images with depth.
    """

    frame: Frame
    views: Sequence[SeenView]


def blind_points(rig: Rig, ground: GroundPlane, surfaces: FrameSurfaces, spacing_m: float) -> Float[np.ndarray, "n 3"]:
    """A grid on the ground where no camera looks, within the outline of what the lower image corners see; ego frame.

    Heights are those of the background mesh where it is within 0.3 m of the plane, else the plane's.
    """
    outline = _outline(rig, ground)
    if outline is None:
        return np.zeros((0, 3))
    low, high = np.floor(outline.min(0) / spacing_m), np.ceil(outline.max(0) / spacing_m)
    cells = np.stack(np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(low, high, strict=True)), indexing="ij"), axis=-1)
    cells = cells.reshape(-1, 2)
    in_tiles = np.lexsort((cells[:, 1] % _TILE, cells[:, 0] % _TILE, cells[:, 1] // _TILE, cells[:, 0] // _TILE))
    xy = cells[in_tiles] * spacing_m
    points = np.column_stack([xy, _height(ground, xy)])
    points = points[_inside(outline, xy)]
    points = points[~rig.sees(points)]
    lifted = points + ground.normal
    drop_m = surfaces.drop_m(lifted, -ground.normal) if len(points) else np.zeros(0)
    near = np.abs(drop_m - 1) < _NEAR_GROUND_M
    points[near] = lifted[near] - drop_m[near, None] * ground.normal
    return np.asarray(points)


def blind_colours(
    points_ego: Float[np.ndarray, "n 3"],
    frame: Frame,
    views: Sequence[SeenView],
    neighbours: Sequence[Neighbour],
    ground: GroundPlane,
) -> UInt8[np.ndarray, "n 3"]:
    """Colours from other frames whose ego stood elsewhere; points that none sees continue what is beside them.

    Args:
        points_ego: on the ground, in the ego frame of ``frame``.
        frame: the frame the points belong to.
        views: its images: their ground pixels lend a colour where nothing better is near.
        neighbours: frames to look the points up in.
        ground: of ``frame``.
    """
    colours = look_up_background(points_ego, frame, neighbours)
    rgb, found = colours.mean(), colours.found
    pixels, pixel_rgb = ground_pixels(views, ground)
    known = np.concatenate([points_ego[found], pixels])
    known_rgb = np.concatenate([rgb[found], pixel_rgb])
    if not len(known):
        known, known_rgb = np.zeros((1, 3)), np.concatenate([v.rgb[-1] for v in views]).mean(0)[None].astype(np.uint8)
    rgb[~found] = lend_colours(points_ego[~found], known, known_rgb)
    return rgb


def lend_colours(
    points: Float[np.ndarray, "n 3"], known: Float[np.ndarray, "m 3"], known_rgb: UInt8[np.ndarray, "m 3"]
) -> UInt8[np.ndarray, "n 3"]:
    """Colours of points on the ground as a mean of the nearest known ones, nearer ones counting more."""
    distance, nearest = KDTree(known[:, :2]).query(points[:, :2], k=min(_NEAREST, len(known)))
    shape = (len(points), min(_NEAREST, len(known)))
    weight = 1 / (distance.reshape(shape) + _EVEN_WITHIN_M)
    lent = (known_rgb[nearest.reshape(shape)] * weight[..., None]).sum(1) / weight.sum(1)[:, None]
    return np.asarray(lent.round(), dtype=np.uint8)


def look_up_background(points_ego: Float[np.ndarray, "n 3"], frame: Frame, neighbours: Sequence[Neighbour]) -> NearestColours:
    """Colours of standing points in frames whose ego stood at least 0.25 m away; the nearest view of a point wins."""
    colours = NearestColours(len(points_ego), 1)
    for other in neighbours:
        other_from_ego = other.frame.world_from_ego.inverse() @ frame.world_from_ego
        if np.linalg.norm(other_from_ego.translation) < MIN_EGO_MOTION_M:
            continue
        points = other_from_ego.apply(points_ego)
        for view in other.views:
            colours.add(look_up(view, points, BACKGROUND, AGREEMENT_M, AGREEMENT_SHARE))
    return colours


def _outline(rig: Rig, ground: GroundPlane) -> Float[np.ndarray, "k 2"] | None:
    """Hull of where the lower image corners meet the ground, and of the cameras themselves."""
    corners = [np.zeros((0, 2))]
    for camera in rig.values():
        pixels = np.array([[0.5, camera.height_px - 0.5], [camera.width_px - 0.5, camera.height_px - 0.5]])
        rays = camera.rays_ego(pixels)
        centre = camera.ego_from_cam.translation
        sinking = -(rays @ ground.normal)
        reach = np.where(sinking > 1e-6, ground.height_m(centre) / np.maximum(sinking, 1e-6), np.inf)
        flat = reach * np.linalg.norm(rays[:, :2], axis=1)
        scale = np.where(flat > _REACH_M, _REACH_M / np.linalg.norm(rays[:, :2], axis=1), reach)
        corners += [centre[None, :2] + scale[:, None] * rays[:, :2], centre[None, :2]]
    points = np.concatenate(corners)
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        return None  # fewer than three places: no area


def _inside(outline: Float[np.ndarray, "k 2"], xy: Float[np.ndarray, "n 2"]) -> np.ndarray:
    """Whether points lie in a convex polygon given counter-clockwise."""
    edge = np.roll(outline, -1, axis=0) - outline
    offset = xy[:, None] - outline[None]
    return np.asarray((edge[None, :, 0] * offset[..., 1] - edge[None, :, 1] * offset[..., 0] >= 0).all(1))


def _height(ground: GroundPlane, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
    return np.asarray(-(xy @ ground.normal[:2] + ground.offset_m) / ground.normal[2])


def ground_pixels(views: Sequence[SeenView], ground: GroundPlane) -> tuple[Float[np.ndarray, "n 3"], UInt8[np.ndarray, "n 3"]]:
    """Background pixels on the ground near the vehicle, thinned, smoothed a little."""
    points, colours = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.uint8)]
    for view in views:
        smooth = cv2.blur(view.rgb, (5, 5))[::3, ::3]
        rays = view.camera.rays_ego(view.camera.pixel_grid()[::3, ::3])
        at = view.camera.ego_from_cam.translation + rays * view.depth_m[::3, ::3, None]
        on = (np.abs(ground.height_m(at)) < _NEAR_GROUND_M) & (np.linalg.norm(at[..., :2], axis=-1) < _REACH_M)
        on &= ~view.near_object[::3, ::3] & (view.source[::3, ::3] != FROM_SKY)
        points.append(at[on])
        colours.append(smooth[on])
    return np.concatenate(points), np.concatenate(colours)
