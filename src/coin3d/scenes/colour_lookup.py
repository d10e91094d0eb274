"""Colours of 3D points, looked up in the images that see them (spec official_code 4, steps 3.1 and 3.4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from coin3d.scenes.render_depth import BACKGROUND
from coin3d.scenes.seen_view import FROM_COMPLETION, FROM_SKY, SeenView
from coin3d.scenes.views import pixel_rays_ego

_IN_THE_WAY = 0.9


@dataclass(frozen=True, eq=False)
class Sightings:
    """Points that one view sees.

    Args:
        row: (m,) which points.
        depth_m: (m,) how far from the camera.
        rgb: (m, 3) the colours found.
    """

    row: Int[np.ndarray, "m"]
    depth_m: Float[np.ndarray, "m"]
    rgb: UInt8[np.ndarray, "m 3"]


def look_up(
    view: SeenView,
    points_ego: Float[np.ndarray, "n 3"],
    box: int,
    tolerance_m: float,
    tolerance_share: float = 0.0,
    normals_ego: Float[np.ndarray, "n 3"] | None = None,
) -> Sightings:
    """Which points a view sees: its depth agrees, the pixel belongs to the right object, and the surface faces it.

    Args:
        view: image with depth, in the same ego frame as the points.
        points_ego: the points.
        box: row of the object that the points are of; ``BACKGROUND`` for points that are on none.
        tolerance_m: by how much the depths may differ.
        tolerance_share: and by which share of the depth in addition: the street is seen at grazing angles.
        normals_ego: outward directions, where known.
    """
    pixels, depth_m = view.camera.project(points_ego)
    row = np.flatnonzero(view.camera.in_image(pixels, depth_m))
    if normals_ego is not None:
        towards = view.camera.ego_from_cam.translation - points_ego[row]
        row = row[np.einsum("ij,ij->i", towards, normals_ego[row]) > 0]
    u, v = np.floor(pixels[row]).astype(np.int64).T
    agrees = np.abs(view.depth_m[v, u] - depth_m[row]) < tolerance_m + tolerance_share * depth_m[row]
    if box == BACKGROUND:
        agrees &= ~view.near_object[v, u] & (view.source[v, u] != FROM_SKY)
    else:
        agrees &= view.box[v, u] == box
    row, u, v = row[agrees], u[agrees], v[agrees]
    return Sightings(row, depth_m[row], view.rgb[v, u])


def shown(points_ego: Float[np.ndarray, "n 3"], views: Sequence[SeenView], tolerance_m: float) -> Bool[np.ndarray, "n"]:
    """Whether points lie on or in front of what some image sees: its own pixels are the better model of that place.

    The farthest depth within two pixels counts (at 400 pixels width), because a point is drawn with a size: hidden just
    behind an edge, it would peep out over it.
    """
    visible = np.zeros(len(points_ego), dtype=bool)
    for view in views:
        pixels, depth_m = view.camera.project(points_ego)
        inside = np.flatnonzero(view.camera.in_image(pixels, depth_m))
        u, v = np.floor(pixels[inside]).astype(np.int64).T
        visible[inside] |= depth_m[inside] < view.farthest_near_m[v, u] + tolerance_m
    return visible


def contradicted(view: SeenView, others: Sequence[SeenView]) -> Bool[np.ndarray, "h w"]:
    """Completed pixels of a view that would stand in the way of what another image of the same frame knows.

    A completed depth is a guess. Where another camera measured something at least a tenth farther along its own ray, or
    the sky, the guess is wrong, and that camera's pixels are there instead.
    """
    at = np.flatnonzero(view.source == FROM_COMPLETION)
    points = view.camera.ego_from_cam.translation + (
        pixel_rays_ego(view.camera).reshape(-1, 3)[at] * view.depth_m.reshape(-1)[at][:, None]
    )
    wrong = np.zeros(len(at), dtype=bool)
    for other in others:
        if other is view:
            continue
        pixels, depth_m = other.camera.project(points)
        inside = np.flatnonzero(other.camera.in_image(pixels, depth_m))
        u, v = np.floor(pixels[inside]).astype(np.int64).T
        wrong[inside] |= (other.source[v, u] != FROM_COMPLETION) & (depth_m[inside] < _IN_THE_WAY * other.depth_m[v, u])
    out = np.zeros(view.depth_m.size, dtype=bool)
    out[at[wrong]] = True
    return out.reshape(view.depth_m.shape)


class NearestColours:
    """Per point the colours of its nearest sightings, averaged in the end.

    Args:
        points: number of points.
        sightings: how many are kept per point.
    """

    def __init__(self, points: int, sightings: int) -> None:
        self._depth_m = np.full((points, sightings), np.inf, dtype=np.float32)
        self._rgb = np.zeros((points, sightings, 3), dtype=np.uint8)

    def add(self, seen: Sightings) -> None:
        """Take the sightings of one view; each replaces a point's farthest one if it is nearer."""
        slot = np.argmax(self._depth_m[seen.row], axis=1)
        nearer = seen.depth_m < self._depth_m[seen.row, slot]
        row, slot = seen.row[nearer], slot[nearer]
        self._depth_m[row, slot] = seen.depth_m[nearer]
        self._rgb[row, slot] = seen.rgb[nearer]

    @property
    def found(self) -> Bool[np.ndarray, "n"]:
        """Which points were seen at all."""
        return np.asarray(np.isfinite(self._depth_m).any(1))

    def mean(self) -> UInt8[np.ndarray, "n 3"]:
        """Mean colours; black where nothing was found."""
        weight = np.isfinite(self._depth_m).astype(np.float32)
        total = (self._rgb * weight[..., None]).sum(1) / np.maximum(weight.sum(1), 1)[:, None]
        return np.asarray(total.round(), dtype=np.uint8)
