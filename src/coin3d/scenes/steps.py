"""The steps of a scene as worker processes run them: each reads files, writes one, and skips what is there."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2

from coin3d.datasets.frame import Frame, LidarSource
from coin3d.geometry import GroundPlane
from coin3d.geometry.mesh import TriangleMesh
from coin3d.records import write_json
from coin3d.rendering import Gaussians, save_gaussians
from coin3d.scenes.assemble import blind_gaussians, view_gaussians
from coin3d.scenes.back_layer import BackLayer
from coin3d.scenes.backing import continue_behind
from coin3d.scenes.blind_area import Neighbour, blind_colours, blind_points
from coin3d.scenes.colour_lookup import contradicted
from coin3d.scenes.frame_quality import frame_quality
from coin3d.scenes.ground import local_ground
from coin3d.scenes.meshes import build_meshes
from coin3d.scenes.object_points import ObjectPoints, model_objects, unseen_points
from coin3d.scenes.options import BuildOptions
from coin3d.scenes.ray_cast import RayCaster
from coin3d.scenes.render_depth import FrameSurfaces
from coin3d.scenes.revealed import coloured_from_elsewhere, hidden_background, without_shown
from coin3d.scenes.seen_view import SeenView, see_frame
from coin3d.scenes.sharpen import sharpened
from coin3d.scenes.views import shrink
from coin3d.scenes.work_files import (
    SceneFiles,
    read_meshes,
    read_models,
    read_views,
    write_meshes,
    write_models,
    write_views,
)


@dataclass(frozen=True, eq=False)
class SceneJob:
    """One scene; it can be sent to another process.

    Args:
        name: of the scene.
        frames: its key frames in time order.
        sweeps: per frame the sweeps until the next one, as (time in ns, source).
        folder: where its files go.
        options: how it is built.
    """

    name: str
    frames: tuple[Frame, ...]
    sweeps: tuple[tuple[tuple[int, LidarSource], ...], ...]
    folder: Path
    options: BuildOptions

    @property
    def files(self) -> SceneFiles:
        return SceneFiles(self.folder)


Seconds = dict[str, float]
"""Time spent by step."""


def fuse_scene(job: SceneJob) -> Seconds:
    """Meshes of the scene."""
    if job.files.mesh_index.is_file():
        return {}
    seconds: Seconds = {}
    with timed(seconds, "meshes"):
        sweeps = {frame.token: list(own) for frame, own in zip(job.frames, job.sweeps, strict=True)}
        write_meshes(job.files, build_meshes(job.frames, lambda f: sweeps[f.token], voxel_m=job.options.voxel_m))
    return seconds


def see(job: SceneJob, index: int) -> Seconds:
    """Depth of all images of one frame."""
    frame = job.frames[index]
    path = job.files.depth(frame.token)
    if path.is_file():
        return {}
    seconds: Seconds = {}
    with timed(seconds, "load meshes"):
        background, objects = _scene_meshes(job.folder)
    with timed(seconds, "depth"):
        surfaces = FrameSurfaces(background, objects, frame)
        views = see_frame(frame, surfaces, local_ground(frame), job.options.completion, job.options.width_px)
        write_views(path, views)
    return seconds


def model(job: SceneJob) -> Seconds:
    """Textured models of all objects of the scene."""
    if job.files.models.is_file():
        return {}
    seconds: Seconds = {}
    with timed(seconds, "object models"):
        width = job.options.width_px
        _, objects = _scene_meshes(job.folder)
        models = model_objects(objects, job.frames, lambda frame: read_views(job.files.depth(frame.token), frame, width), width)
        write_models(job.files.models, models)
    return seconds


def assemble(job: SceneJob, index: int) -> Seconds:
    """Gaussians of one frame, and how good they are."""
    frame, options = job.frames[index], job.options
    if job.files.quality(frame.token).is_file() and job.files.gaussians(frame.token).is_file():
        return {}
    seconds: Seconds = {}
    with timed(seconds, "read"):
        background, objects = _scene_meshes(job.folder)
        views = _views(job, index)
        ground = local_ground(frame)
        around = [i for i in range(index - options.neighbours, index + options.neighbours + 1) if i != index]
        neighbours = [Neighbour(job.frames[i], _views(job, i)) for i in around if 0 <= i < len(job.frames)]
        models = _scene_models(job.folder)
    with timed(seconds, "hidden background"):
        layers = [_back_layers(view, views, frame, ground, neighbours, options) for view in views]
    with timed(seconds, "blind area"):
        surfaces = FrameSurfaces(background, objects, frame)
        rig = frame.rig.with_cameras({name: shrink(c, options.width_px) for name, c in frame.rig.items()})
        blind = blind_points(rig, ground, surfaces, options.blind_spacing_m)
        blind_rgb = blind_colours(blind, frame, views, neighbours, ground)
    with timed(seconds, "Gaussians"):
        parts = [
            view_gaussians(v, contradicted(v, views), behind, ground, options.radii)
            for v, behind in zip(views, layers, strict=True)
        ]
        unseen = unseen_points(models, frame, views, options.object_range_m)
        below = blind_gaussians(blind, blind_rgb, options.blind_spacing_m, options.radii)
        gaussians = Gaussians.concatenate([*(p.seen for p in parts), *(p.behind for p in parts), unseen, below])
    with timed(seconds, "sharpen"):
        gaussians = sharpened(gaussians, parts, views, options.sharpen)
        save_gaussians(job.files.gaussians(frame.token), gaussians)
    with timed(seconds, "quality"):
        write_json(job.files.quality(frame.token), frame_quality(frame.token, gaussians, views, ground))
    return seconds


def start_worker() -> None:
    """Processes are the parallelism: libraries stay on one thread each. Nothing of an earlier build is remembered."""
    cv2.setNumThreads(1)
    _VIEWS.clear()
    _scene_meshes.cache_clear()
    _scene_models.cache_clear()


def _back_layers(
    view: SeenView,
    views: Sequence[SeenView],
    frame: Frame,
    ground: GroundPlane,
    neighbours: Sequence[Neighbour],
    options: BuildOptions,
) -> list[BackLayer]:
    """The background behind objects, and a band behind other near edges."""
    hidden = hidden_background(view, frame, ground, options.completion, options.inpainting)
    hidden = without_shown(hidden, view, views)
    hidden = coloured_from_elsewhere(hidden, view, views, frame, neighbours, ground)
    band = continue_behind(view.depth_m, view.rgb, round(options.band * view.camera.width_px))
    behind_edges = BackLayer(band.mask & ~view.near_object, band.depth_m, band.rgb)
    return [hidden, without_shown(behind_edges, view, views)]


# worker processes see few scenes at a time, and consecutive frames share their neighbours
@lru_cache(maxsize=2)
def _scene_meshes(folder: Path) -> tuple[RayCaster, dict[str, TriangleMesh]]:
    background, objects = read_meshes(SceneFiles(folder))
    return RayCaster(background), objects


@lru_cache(maxsize=2)
def _scene_models(folder: Path) -> dict[str, ObjectPoints]:
    return read_models(SceneFiles(folder).models)


_VIEWS: dict[tuple[Path, str], list[SeenView]] = {}


def _views(job: SceneJob, index: int) -> list[SeenView]:
    frame = job.frames[index]
    key = (job.folder, frame.token)
    if key not in _VIEWS:
        while len(_VIEWS) > 2 * job.options.neighbours + 2:
            del _VIEWS[next(iter(_VIEWS))]
        _VIEWS[key] = read_views(job.files.depth(frame.token), frame, job.options.width_px)
    return _VIEWS[key]


@contextmanager
def timed(seconds: Seconds, step: str) -> Iterator[None]:
    """Add the processor time of the block."""
    begin = time.process_time()
    yield
    seconds[step] = seconds.get(step, 0.0) + time.process_time() - begin
