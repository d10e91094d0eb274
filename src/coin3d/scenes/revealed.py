"""What stands behind the objects of a view, for views from elsewhere (spec official_code 4, steps 3.5 and 3.6)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from coin3d.datasets.frame import Frame
from coin3d.geometry import GroundPlane
from coin3d.scenes.back_layer import BackLayer
from coin3d.scenes.blind_area import Neighbour, ground_pixels, lend_colours, look_up_background
from coin3d.scenes.colour_lookup import shown
from coin3d.scenes.completion import DepthCompletion
from coin3d.scenes.ground import plane_depth
from coin3d.scenes.inpainting import Inpainting
from coin3d.scenes.render_depth import BACKGROUND
from coin3d.scenes.seen_view import FROM_SKY, OWN_VEHICLE, SeenView
from coin3d.scenes.sky import SKY_DEPTH_M, find_sky
from coin3d.scenes.steep_pixels import snap_steep
from coin3d.scenes.views import pixel_rays_ego

_MIN_GAP_M = 0.2
_MIN_GAP_SHARE = 0.02
_STREET_M = 0.3


def hidden_background(
    view: SeenView, frame: Frame, ground: GroundPlane, completion: DepthCompletion, inpainting: Inpainting
) -> BackLayer:
    """The background behind the objects of a view.

    Depth: that of the background mesh, which other sweeps saw; where it has a hole, the background around the object is
    completed across, and nothing lies under the plane through the bottom of the object's box. The own vehicle is such an
    object, on the ground.
    """
    mask = view.near_object
    if not mask.any():
        return BackLayer(mask, view.depth_m, view.rgb)
    rgb = inpainting(view.rgb, mask)
    around_m = np.where(mask | (view.source == FROM_SKY), 0, view.depth_m)
    known_m = np.where(mask, view.behind_m, around_m).astype(np.float32)
    sky = ((view.source == FROM_SKY) & ~mask) | (mask & find_sky(rgb, known_m, view.camera, ground))
    depth_m = np.asarray(completion(rgb, known_m, sky, view.camera, ground))
    bottoms_m = np.full(mask.shape, np.inf)
    for row in np.unique(view.box[view.box != BACKGROUND]):
        plane = ground if row == OWN_VEHICLE else _bottom_plane(frame, int(row))
        inside = view.box == row
        bottoms_m[inside] = plane_depth(view.camera, plane)[inside]
    depth_m = np.where(known_m > 0, known_m, np.minimum(depth_m, bottoms_m))
    depth_m = snap_steep(np.where(sky, SKY_DEPTH_M, depth_m).astype(np.float32), known_m <= 0)
    new = mask & (depth_m > view.depth_m * (1 + _MIN_GAP_SHARE) + _MIN_GAP_M)
    return BackLayer(new, depth_m, rgb)


def coloured_from_elsewhere(
    layer: BackLayer,
    view: SeenView,
    views: Sequence[SeenView],
    frame: Frame,
    neighbours: Sequence[Neighbour],
    ground: GroundPlane,
) -> BackLayer:
    """The layer with the colours that other frames saw; the street that none saw continues the street beside it.

    Args:
        layer: with inpainted colours, which remain where nothing better is known.
        view: the view it is behind.
        views: all views of the frame.
        frame: the key frame.
        neighbours: other frames of the scene.
        ground: of the frame.
    """
    at = np.flatnonzero(layer.mask)
    if not len(at):
        return layer
    points = _points(layer, view, at)
    seen = look_up_background(points, frame, neighbours)
    colour = np.where(seen.found[:, None], seen.mean(), layer.rgb.reshape(-1, 3)[at])
    street = np.abs(ground.height_m(points)) < _STREET_M
    known, known_rgb = ground_pixels(views, ground)
    known = np.concatenate([known, points[street & seen.found]])
    known_rgb = np.concatenate([known_rgb, colour[street & seen.found]])
    guessed = street & ~seen.found
    if guessed.any() and len(known):
        colour[guessed] = lend_colours(points[guessed], known, known_rgb)
    rgb = layer.rgb.reshape(-1, 3).copy()
    rgb[at] = colour
    return BackLayer(layer.mask, layer.depth_m, rgb.reshape(layer.rgb.shape))


def without_shown(layer: BackLayer, view: SeenView, views: Sequence[SeenView]) -> BackLayer:
    """The layer without what the other images of the frame show or look through: there they are the better model."""
    at = np.flatnonzero(layer.mask)
    others = [other for other in views if other is not view]
    mask = np.zeros(layer.mask.size, dtype=bool)
    mask[at[~shown(_points(layer, view, at), others, _MIN_GAP_M)]] = True
    return BackLayer(mask.reshape(layer.mask.shape), layer.depth_m, layer.rgb)


def _points(layer: BackLayer, view: SeenView, at: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n 3"]:
    rays = pixel_rays_ego(view.camera).reshape(-1, 3)[at]
    return np.asarray(view.camera.ego_from_cam.translation + rays * layer.depth_m.reshape(-1)[at][:, None])


def _bottom_plane(frame: Frame, row: int) -> GroundPlane:
    """Plane of the ego frame through the bottom of a box, level in the world as boxes are."""
    if frame.boxes_world is None:
        raise ValueError(f"frame {frame.token} has no boxes")
    up = frame.world_from_ego.inverse().rotate(np.array([0.0, 0.0, 1.0]))
    bottom = frame.boxes_world.centre_m[row] - np.array([0, 0, frame.boxes_world.size_m[row, 2] / 2])
    return GroundPlane(up, -float(up @ frame.world_from_ego.inverse().apply(bottom)))
