"""Textured point models of the objects, for the sides that the images of a frame do not show (spec official_code 4, step 3.1).

Colours come from all frames of the scene that see the surface; what none sees takes the colour of its mirror image.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, UInt8
from scipy.spatial import KDTree

from coin3d.datasets.frame import Frame
from coin3d.geometry import MIN_DEPTH_M, Camera
from coin3d.geometry.mesh import TriangleMesh
from coin3d.rendering import Gaussians
from coin3d.scenes.colour_lookup import NearestColours, look_up, shown
from coin3d.scenes.render_depth import ego_from_box
from coin3d.scenes.seen_view import SeenView
from coin3d.scenes.surface_samples import SurfaceSamples, sample_surface
from coin3d.scenes.tracks import instance_names
from coin3d.scenes.views import PAPER_WIDTH_PX, shrink

PAPER_SPACING_M = 0.014
"""The paper samples every 0.01 m and then keeps every other point."""

AGREEMENT_M = 0.1
VIEWS_PER_POINT = 3
MIN_DEPTH_STEP_M = 1.0
_MOST_POINTS = 300_000
# points need not be denser than this many of the nearest image's pixels
_SPACING_PX = 0.7
# random points leave gaps of twice their mean distance
_STD_SHARE = 0.7
_UNDERSIDE = -0.7  # z of the normal


@dataclass(frozen=True, eq=False)
class ObjectPoints:
    """A textured point model in random order, so that a leading part of it is the same model, coarser.

    Args:
        points_m: (n, 3) in the box frame.
        rgb: (n, 3).
        spacing_m: mean distance of neighbours.
    """

    points_m: Float32[np.ndarray, "n 3"]
    rgb: UInt8[np.ndarray, "n 3"]
    spacing_m: float


def model_objects(
    objects: Mapping[str, TriangleMesh],
    frames: Sequence[Frame],
    views_of: Callable[[Frame], Sequence[SeenView]],
    width_px: int,
) -> dict[str, ObjectPoints]:
    """Point models of all objects that some image shows.

    Points are 0.014 m apart for images 800 pixels wide (paper) and in inverse proportion for narrower ones, but never
    closer than 0.7 pixels of the nearest image that may show the object. Undersides are left out.

    Args:
        objects: meshes in the box frame by instance name.
        frames: key frames of the scene.
        views_of: images with depth of a frame; asked for once per frame, in order.
        width_px: width the views are built at.
    """
    chosen, nearest_m_per_px = _choose_views(frames, width_px)
    samples: dict[str, SurfaceSamples] = {}
    spacing: dict[str, float] = {}
    for name in sorted(set(objects) & set(nearest_m_per_px)):
        spacing[name] = max(PAPER_SPACING_M * max(1.0, PAPER_WIDTH_PX / width_px), _SPACING_PX * nearest_m_per_px[name])
        sampled = sample_surface(objects[name], spacing[name], _MOST_POINTS, zlib.crc32(name.encode()))
        upper = sampled.normals[:, 2] > _UNDERSIDE
        samples[name] = SurfaceSamples(sampled.points_m[upper], sampled.normals[upper])
    colours = {name: NearestColours(len(s.points_m), VIEWS_PER_POINT) for name, s in samples.items()}
    for index, frame in enumerate(frames):
        views: dict[str, SeenView] = {}
        for row, name in enumerate(instance_names(frame)):
            cameras = chosen.get((index, name), ()) if name in samples else ()
            if not cameras:
                continue
            views = views or {view.name: view for view in views_of(frame)}
            pose = ego_from_box(frame, row)
            points, normals = pose.apply(samples[name].points_m), pose.rotate(samples[name].normals)
            for camera in cameras:
                colours[name].add(look_up(views[camera], points, row, AGREEMENT_M, normals_ego=normals))
    models = {name: _finished(samples[name], colours[name], spacing[name]) for name in samples}
    return {name: model for name, model in models.items() if len(model.points_m)}


def unseen_points(models: Mapping[str, ObjectPoints], frame: Frame, views: Sequence[SeenView], max_range_m: float) -> Gaussians:
    """The points of all models that no image of the frame shows: hidden, turned away, or out of view.

    Args:
        models: of the scene's objects.
        frame: says where they are.
        views: all its images with depth.
        max_range_m: objects farther than that from the ego are left out.
    """
    parts = []
    for row, name in enumerate(instance_names(frame)):
        if name not in models:
            continue
        pose = ego_from_box(frame, row)
        distance_m = float(np.linalg.norm(pose.translation[:2]))
        if distance_m > max_range_m:
            continue
        model = models[name]
        focal_px = max(view.camera.focal_px for view in views)
        spacing_m = max(model.spacing_m, _SPACING_PX * distance_m / focal_px)
        count = round(len(model.points_m) * (model.spacing_m / spacing_m) ** 2)
        points = pose.apply(model.points_m[:count])
        hidden = ~shown(points, views, AGREEMENT_M)
        std_m = np.full(int(hidden.sum()), _STD_SHARE * spacing_m, dtype=np.float32)
        parts.append(Gaussians(points[hidden].astype(np.float32), std_m, model.rgb[:count][hidden]))
    return Gaussians.concatenate(parts)


def _choose_views(frames: Sequence[Frame], width_px: int) -> tuple[dict[tuple[int, str], tuple[str, ...]], dict[str, float]]:
    """Which cameras to ask about which instance in which frame, and the metres per pixel of each instance's nearest view.

    Per instance and camera the nearest frame is taken, then each next one that is at least 1 m farther.
    """
    candidates: dict[tuple[str, str], list[tuple[float, int]]] = {}
    finest: dict[str, float] = {}
    for index, frame in enumerate(frames):
        cameras = {name: shrink(camera, width_px) for name, camera in frame.rig.items()}
        if frame.boxes is None:
            continue
        corners = frame.boxes.corners()
        for row, instance in enumerate(instance_names(frame)):
            for name, camera in cameras.items():
                depth_m = _depth_if_seen(camera, corners[row])
                if depth_m is not None:
                    candidates.setdefault((instance, name), []).append((depth_m, index))
                    finest[instance] = min(finest.get(instance, np.inf), depth_m / camera.focal_px)
    chosen: dict[tuple[int, str], tuple[str, ...]] = {}
    for (instance, name), seen in sorted(candidates.items()):
        last_m = -np.inf
        for depth_m, index in sorted(seen):
            if depth_m >= last_m + MIN_DEPTH_STEP_M:
                chosen[index, instance] = (*chosen.get((index, instance), ()), name)
                last_m = depth_m
    return chosen, finest


def _depth_if_seen(camera: Camera, corners_ego: Float[np.ndarray, "8 3"]) -> float | None:
    """Depth of a box's centre, None where the camera cannot show any of it."""
    pixels, depth_m = camera.project(corners_ego)
    front = depth_m > MIN_DEPTH_M
    if not front.any():
        return None
    low, high = pixels[front].min(0), pixels[front].max(0)
    if (high < 0).any() or low[0] > camera.width_px or low[1] > camera.height_px:
        return None
    return float(max(depth_m.mean(), MIN_DEPTH_M))


def _finished(samples: SurfaceSamples, colours: NearestColours, spacing_m: float) -> ObjectPoints:
    found, rgb = colours.found, colours.mean()
    if not found.any():
        return ObjectPoints(samples.points_m[:0], rgb[:0], spacing_m)
    missing = np.flatnonzero(~found)
    mirrored = samples.points_m[missing] * np.array([1, -1, 1], dtype=np.float32)
    _, nearest = KDTree(samples.points_m[found]).query(mirrored)
    rgb[missing] = rgb[found][nearest]
    return ObjectPoints(samples.points_m, rgb, spacing_m)
