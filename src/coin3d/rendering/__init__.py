"""Gaussians to images: ``render(gaussians, cameras)``. The definition is in reference.py, the speed in cpu.py."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from coin3d.geometry import Camera
from coin3d.rendering.cpu import PreparedGaussians, prepare, render_cpu
from coin3d.rendering.cuda import render_cuda
from coin3d.rendering.gaussian_file import load_gaussians, save_gaussians
from coin3d.rendering.gaussians import Gaussians
from coin3d.rendering.view import Rendering

__all__ = ["Gaussians", "PreparedGaussians", "Rendering", "load_gaussians", "prepare", "render", "save_gaussians"]


def render(
    gaussians: Gaussians | PreparedGaussians,
    cameras: Sequence[Camera],
    *,
    threads: int = 1,
    device: Literal["cpu", "cuda"] = "cpu",
) -> list[Rendering]:
    """Render one image per camera, in order.

    Args:
        gaussians: the scene. ``prepare`` it first if it is rendered in several calls.
        cameras: pinhole cameras of any size, number and principal point.
        threads: of the CPU. Results are the same bit by bit for any number.
        device: "cuda" renders with gsplat, which has to be installed.

    Raises:
        ValueError: a camera that is no pinhole, or fewer threads than one.
    """
    if device == "cuda":
        return render_cuda(gaussians.gaussians if isinstance(gaussians, PreparedGaussians) else gaussians, cameras)
    return render_cpu(gaussians, cameras, threads=threads)
