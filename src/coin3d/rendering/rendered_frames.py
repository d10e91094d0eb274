"""Frames of a recording as another rig would have seen them: same world, same boxes, rendered images."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from coin3d.datasets.frame import Frame
from coin3d.geometry import Rig
from coin3d.rendering import render
from coin3d.rendering.gaussian_folder import GaussianFolder


def rendered_frames(frames: Iterable[Frame], gaussians: GaussianFolder, rig: Rig, threads: int = 1) -> Iterator[Frame]:
    """Render frames through a rig, one after the other.

    Boxes, LiDAR, poses and times stay. The rig's cameras are mounted on the vehicle of the recording, whose ground it keeps. A
    rendered image has no time of its own: all cameras see the reference time of the frame.

    Args:
        frames: of the recording that the Gaussians were built from; those without Gaussians are left out.
        gaussians: its built scenes.
        rig: cameras at the size to be rendered, pinhole ones.
        threads: of the renderer.

    Raises:
        ValueError: a camera that is no pinhole, or a damaged file.
    """
    for frame in frames:
        cloud = gaussians.load(frame.scene, frame.token)
        if cloud is None:
            continue
        mounted = replace(rig, ground=frame.rig.ground, ego_from_vehicle=frame.rig.ego_from_vehicle)
        renderings = render(cloud, list(mounted.values()), threads=threads)
        images = {name: rendering.rgb for name, rendering in zip(mounted, renderings, strict=True)}
        yield replace(frame, rig=mounted, images=images, own_vehicle={})
