"""Rendering by native code on the CPU: as ``reference.py`` defines it, in single precision."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64

from coin3d import native
from coin3d.geometry import Camera
from coin3d.rendering.gaussians import Gaussians
from coin3d.rendering.view import Rendering, require_pinhole, slope_limits

CHUNK: int = native.splat_chunk
"""Consecutive Gaussians that are culled together."""


def instruction_sets() -> tuple[str, ...]:
    """What this machine can run, fastest first: of "avx512", "avx2" and "baseline"."""
    return tuple(native.splat_instruction_sets())


@dataclass(frozen=True, eq=False)
class PreparedGaussians:
    """Gaussians with a bounding sphere per chunk: made once, rendered through any number of cameras.

    Args:
        gaussians: the scene; its arrays are used where they are, without a copy.
        bounds: (c, 5) per chunk the sphere around its centres (x, y, z, radius in metres) and its largest ``std_m``.
    """

    gaussians: Gaussians
    bounds: Float32[np.ndarray, "c 5"]


def prepare(gaussians: Gaussians) -> PreparedGaussians:
    """Compute the bounding spheres; a few milliseconds per million Gaussians."""
    bounds = np.empty((-(-len(gaussians) // CHUNK), 5), np.float32)
    native.splat_bounds(gaussians.centre_m, gaussians.std_m, bounds)
    return PreparedGaussians(gaussians, bounds)


def render_cpu(
    scene: Gaussians | PreparedGaussians, cameras: Sequence[Camera], *, threads: int = 1, instruction_set: str | None = None
) -> list[Rendering]:
    """Render one image per camera.

    Args:
        scene: Gaussians, prepared or not.
        cameras: pinhole cameras of any size.
        threads: how many to use; the images are the same bit by bit for any number.
        instruction_set: one of ``instruction_sets()``, the fastest by default.

    Raises:
        ValueError: a camera with another lens, no threads, or an instruction set that this machine cannot run.
    """
    require_pinhole(cameras)
    if threads < 1:
        raise ValueError(f"rendering needs at least one thread, got {threads}")
    prepared = scene if isinstance(scene, PreparedGaussians) else prepare(scene)
    g = prepared.gaussians
    sizes = [(c.height_px, c.width_px) for c in cameras]
    renderings = [Rendering(np.empty((*s, 3), np.uint8), np.empty(s, np.float32), np.empty(s, np.float32)) for s in sizes]
    rows = np.stack([_row(c) for c in cameras]) if cameras else np.zeros((0, 24))
    native.splat_render(
        g.centre_m, g.std_m, g.rgb, prepared.bounds, rows,
        [r.rgb for r in renderings], [r.depth_m for r in renderings], [r.alpha for r in renderings],
        threads, instruction_set or instruction_sets()[0],
    )  # fmt: skip
    return renderings


def _row(camera: Camera) -> Float64[np.ndarray, "24"]:
    """A camera as native code reads it."""
    pose, limits = camera.ego_from_cam, slope_limits(camera)
    slopes = [limits.x_min, limits.x_max, limits.y_min, limits.y_max]
    size = [camera.width_px, camera.height_px]
    return np.concatenate([pose.rotation.T.ravel(), pose.translation, camera.K[:2].ravel(), slopes, size])
