"""Step 1.1: one background mesh and a mesh of every instance, from the sweeps of a scene (paper sec. 4.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from coin3d.datasets.frame import Frame
from coin3d.geometry.mesh import TriangleMesh
from coin3d.scenes.fuse import FusionSettings, fuse
from coin3d.scenes.split import ObjectRays, SweepsOf, no_sweeps, split_scene
from coin3d.scenes.watertight import MIN_POINTS, close_object, object_voxel_m


@runtime_checkable
class MeshRepair(Protocol):
    """Makes the open mesh of an object watertight; for libraries whose licence keeps them out of this package."""

    def __call__(self, mesh: TriangleMesh, points_m: Float[np.ndarray, "n 3"]) -> TriangleMesh:
        """The repaired mesh, in the box frame like the mesh and the points it was made of."""
        ...


@dataclass(frozen=True, eq=False)
class ObjectMesh:
    """What became of one instance.

    Args:
        mesh: in the box frame (origin at the box centre, x forward, z up), or None.
        num_points: points it was seen by.
        watertight: whether the mesh is closed.
        reason: why there is no mesh, or "".
    """

    mesh: TriangleMesh | None
    num_points: int
    watertight: bool
    reason: str = ""


@dataclass(frozen=True, eq=False)
class SceneMeshes:
    """The meshes of a scene.

    Args:
        background: in the world frame.
        objects: by instance name, as ``tracks.instance_names`` gives them for the boxes of a frame. The pose of an object at a
            frame is that of its box there.
        settings: how the background was fused.
        num_sweeps: sweeps that were fused.
    """

    background: TriangleMesh
    objects: dict[str, ObjectMesh]
    settings: FusionSettings
    num_sweeps: int


def build_meshes(
    frames: Sequence[Frame],
    sweeps_of: SweepsOf = no_sweeps,
    *,
    voxel_m: float = 0.1,
    repair: MeshRepair | None = None,
    threads: int = 1,
) -> SceneMeshes:
    """Split, fuse and close.

    Args:
        frames: key frames of one scene in time order. Frames without LiDAR contribute boxes only.
        sweeps_of: the sweeps between them, for example ``recording.sweeps``.
        voxel_m: voxels of the background; objects have their own.
        repair: closes object meshes in place of ``watertight.close_object``.
        threads: of the fusion; the result does not depend on it.

    Raises:
        ValueError: frames out of order, an instance twice in a frame, or a sweep that cannot be read.
    """
    split = split_scene(frames, sweeps_of)
    settings = FusionSettings.for_sweeps(split.num_sweeps, voxel_m)
    background = fuse(split.background, settings, threads).surface(threads)
    objects = {name: _object_mesh(seen, repair, threads) for name, seen in split.objects.items()}
    return SceneMeshes(background, objects, settings, split.num_sweeps)


def _object_mesh(seen: ObjectRays, repair: MeshRepair | None, threads: int) -> ObjectMesh:
    if seen.num_points < MIN_POINTS:
        return ObjectMesh(None, seen.num_points, False, f"seen by {seen.num_points} points, a mesh takes {MIN_POINTS}")
    size_m = seen.track.size_m
    if repair is None:
        mesh = close_object(seen.rays, size_m, threads)
    else:
        settings = FusionSettings(object_voxel_m(size_m), min_weight=1.0, spread=1)
        mesh = fuse(seen.rays, settings, threads).surface(threads)
        mesh = repair(mesh, seen.rays.points_m) if len(mesh.faces) else mesh
    if not len(mesh.faces):
        return ObjectMesh(None, seen.num_points, False, "the points form no surface")
    return ObjectMesh(mesh, seen.num_points, mesh.is_watertight)
