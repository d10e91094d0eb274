"""Step 1.1, second half: rays to a truncated signed distance field, and to a mesh (paper sec. 4.2; VDBFusion)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int32

from coin3d.geometry.mesh import TriangleMesh
from coin3d.native import TsdfVolume, fill_holes, marching_cubes
from coin3d.scenes.normals import free_directions
from coin3d.scenes.ray_cloud import RayCloud

_BATCH = 1 << 20
BLOCK_SIDE = 8


@dataclass(frozen=True)
class FusionSettings:
    """How rays become a field. Space between sensor and surface is not carved.

    Args:
        voxel_m: side of a voxel.
        truncation_voxels: half the width of the band around a surface, in voxels, 1 to 16.
        spread: voxels beside the one hit that a point also tells, at weight 1 / (1 + squared offset), 0 to 3.
        min_weight: voxels with less have no value; a point adds 1 to every voxel it hits in the middle.
        fill_holes: voxels without value that have one in more than half of their 26 neighbours take the mean, once. This
            closes pinholes and notches one voxel wide and leaves straight rims where they are.
        normal_cells: sides of the cells that normals are estimated in, in voxels, small ones first; empty: distances are
            measured along the rays.

    Raises:
        ValueError: a value out of range.
    """

    voxel_m: float = 0.1
    truncation_voxels: float = 3.0
    spread: int = 0
    min_weight: float = 5.0
    fill_holes: bool = True
    normal_cells: tuple[float, ...] = (4.0, 12.0)

    def __post_init__(self) -> None:
        if not (self.voxel_m > 0 and 1 <= self.truncation_voxels <= 16 and 0 <= self.spread <= 3):
            raise ValueError(f"voxels are larger than 0, truncation is 1 to 16 of them and spread 0 to 3, got {self}")
        if self.min_weight < 0 or any(c <= 0 for c in self.normal_cells):
            raise ValueError(f"min_weight is 0 or more and normal_cells are larger than 0, got {self}")

    @classmethod
    def for_sweeps(cls, sweeps: int, voxel_m: float = 0.1) -> FusionSettings:
        """What suits a scene of so many sweeps.

        From 200 sweeps on (a nuScenes scene at 20 Hz has about 400) this is the released setting: truncation of three voxels
        and five observations. With fewer, a voxel sees fewer points: the least weight falls with their number, and points
        also speak for the voxels beside them, so that surfaces close between the rings of the LiDAR. The narrower band of
        the sparsest scenes keeps the two sides of thin things apart, which no majority of observations does there.
        """
        if sweeps >= 200:
            return cls(voxel_m)
        if sweeps >= 40:
            return cls(voxel_m, min_weight=float(sweeps // 40), spread=1)
        return cls(voxel_m, truncation_voxels=2.5, min_weight=1.0 if sweeps >= 10 else 0.2, spread=2)


@dataclass(frozen=True, eq=False)
class Field:
    """A signed distance on sparse blocks.

    Args:
        coords: (b, 3) blocks; voxel (0, 0, 0) of block (i, j, k) has its centre at (8 i + 0.5, 8 j + 0.5, 8 k + 0.5) voxels.
        distance_m: (b, 8, 8, 8) positive in free space, NaN where nothing is known.
        voxel_m: side of a voxel.
    """

    coords: Int32[np.ndarray, "b 3"]
    distance_m: Float32[np.ndarray, "b 8 8 8"]
    voxel_m: float

    def surface(self, threads: int = 1) -> TriangleMesh:
        """The zero surface: only in cubes whose eight corners have a value; vertices are shared, also across blocks."""
        vertices, faces = marching_cubes(self.coords, self.distance_m, self.voxel_m, threads)
        return TriangleMesh.create(vertices, faces)


def fuse(cloud: RayCloud, settings: FusionSettings, threads: int = 1) -> Field:
    """The field of a cloud of rays. The result is the same for any number of threads.

    Raises:
        ValueError: a point that is not finite or absurdly far away.
    """
    volume = TsdfVolume(settings.voxel_m, settings.voxel_m * settings.truncation_voxels)
    cells_m = [c * settings.voxel_m for c in settings.normal_cells]
    toward = free_directions(cloud, cells_m, max_thickness_m=0.4 * settings.voxel_m)
    for first in range(0, len(cloud), _BATCH):
        rows = slice(first, first + _BATCH)
        volume.integrate(
            np.ascontiguousarray(cloud.points_m[rows], dtype=np.float64),
            np.ascontiguousarray(toward[rows]),
            spread=settings.spread,
            threads=threads,
        )
    coords = np.empty((volume.blocks, 3), dtype=np.int32)
    distance_m = np.empty((volume.blocks, BLOCK_SIDE, BLOCK_SIDE, BLOCK_SIDE), dtype=np.float32)
    volume.field(coords, distance_m, settings.min_weight, threads)
    if settings.fill_holes:
        filled = np.empty_like(distance_m)
        fill_holes(coords, distance_m, filled, threads)
        distance_m = filled
    return Field(coords, distance_m, settings.voxel_m)
