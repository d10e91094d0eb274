"""A sheet per scene: what each step made of one key frame."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, UInt8

from coin3d.drawing.colours import BACKGROUND as DARK
from coin3d.drawing.colours import colour_map
from coin3d.drawing.pictures import draw_boxes
from coin3d.drawing.sheet import Panel, save_png, sheet
from coin3d.geometry import GroundPlane
from coin3d.rendering import Gaussians, load_gaussians, render
from coin3d.scenes.ground import local_ground
from coin3d.scenes.render_depth import BACKGROUND
from coin3d.scenes.seen_view import FROM_LIDAR, FROM_MESH, FROM_SKY, SeenView
from coin3d.scenes.sky import SKY_DEPTH_M
from coin3d.scenes.steps import SceneJob, Seconds, timed
from coin3d.scenes.work_files import read_views

_NEAREST_M = 1.5
_CEILING_M = 3.5
_SKY_TINT = (90, 140, 255)


def draw_scene(job: SceneJob) -> Seconds:
    """Draw the middle frame of a built scene into its ``sheet.png``; its depth must still be there."""
    seconds: Seconds = {}
    with timed(seconds, "picture"):
        save_png(scene_picture(job, len(job.frames) // 2), job.files.picture)
    return seconds


def scene_picture(job: SceneJob, index: int, cell_width_px: int = 400, range_m: float = 30.0) -> UInt8[np.ndarray, "h w 3"]:
    """What each step made of one key frame of a scene."""
    frame = job.frames[index]
    views = read_views(job.files.depth(frame.token), frame, job.options.width_px)
    gaussians = load_gaussians(job.files.gaussians(frame.token))
    rendered = render(gaussians, [view.camera for view in views])
    panels = []
    for view, image in zip(views, rendered, strict=True):
        measured = np.where((view.source == FROM_MESH) | (view.source == FROM_LIDAR), view.depth_m, np.nan)
        boxed = view.rgb if frame.boxes is None else draw_boxes(view.rgb, view.camera, frame.boxes)
        panels += [
            Panel(boxed, view.name),
            Panel(_depth(measured), "measured depth (meshes, LiDAR)"),
            Panel(_depth(view.depth_m), "completed depth"),
            Panel(_masks(view), "objects by colour, sky blue"),
            Panel(image.rgb, f"rendered from its Gaussians, {_psnr_db(view, image.rgb):.1f} dB"),
        ]
    title = f"{job.name}   {frame.token}   {len(gaussians) / 1e6:.2f} M Gaussians"
    above = top_view_of(gaussians, local_ground(frame), range_m, 2 * cell_width_px)
    panels.append(Panel(above, f"Gaussians below {_CEILING_M:g} m from above, {2 * range_m:.0f} m wide, forward is up"))
    return sheet(panels, 5, cell_width_px, title)


def top_view_of(gaussians: Gaussians, ground: GroundPlane, range_m: float, size_px: int) -> UInt8[np.ndarray, "s s 3"]:
    """The Gaussians from above, the highest one below 3.5 m in each pixel; forward is up, left is left."""
    points = gaussians.centre_m.astype(np.float64)
    height_m = ground.height_m(points)
    scale = size_px / (2 * range_m)
    right = np.floor(size_px / 2 - points[:, 1] * scale).astype(np.int64)
    down = np.floor(size_px / 2 - points[:, 0] * scale).astype(np.int64)
    inside = (height_m < _CEILING_M) & (right >= 0) & (right < size_px) & (down >= 0) & (down < size_px)
    order = np.argsort(height_m[inside], kind="stable")
    out = np.full((size_px, size_px, 3), DARK, dtype=np.uint8)
    # of repeated places the last assignment, the highest, stays
    out[down[inside][order], right[inside][order]] = gaussians.rgb[inside][order]
    return out


def _depth(depth_m: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    return colour_map(np.log(depth_m), float(np.log(_NEAREST_M)), float(np.log(SKY_DEPTH_M)), "turbo_r")


def _masks(view: SeenView) -> UInt8[np.ndarray, "h w 3"]:
    out = (view.rgb * 0.45).astype(np.uint8)
    out[view.source == FROM_SKY] = _SKY_TINT
    objects = view.box != BACKGROUND
    out[objects] = colour_map((view.box * 7 % 20).astype(np.float64), 0, 19, "tab20")[objects]
    return out


def _psnr_db(view: SeenView, rgb: UInt8[np.ndarray, "h w 3"]) -> float:
    error = np.square(view.rgb.astype(np.float32) - rgb).mean()
    return float(10 * np.log10(255**2 / max(float(error), 1e-6)))
