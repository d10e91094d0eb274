"""Which way is free space at a LiDAR return: the normal of a flat neighbourhood, or the way back to the sensor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from coin3d.scenes.ray_cloud import RayCloud

_MIN_POINTS = 8
# a neighbourhood is flat if it is this much thinner than it is wide in its narrower direction, in standard deviations
_MIN_FLATNESS = 3.0
# below this cosine between normal and ray one point cannot tell the side; the neighbourhood's mean ray does
_GRAZING = 0.05


def free_directions(cloud: RayCloud, cells_m: Sequence[float], max_thickness_m: float) -> Float32[np.ndarray, "n 3"]:
    """(n, 3) unit vectors towards free space.

    A distance measured along the ray of a grazing LiDAR says little about the ground: 10 m from the sensor, a band of 0.3 m
    along the ray covers 5 cm of height, less than a voxel, and no surface can be extracted. Where the points of a cell of a
    regular grid are flat, distances are therefore measured along their normal, turned to the side of the sensor; elsewhere
    along the ray, as in VDBFusion.

    Args:
        cloud: the rays.
        cells_m: sides of the cells, the first in which a point's neighbourhood is flat counts; in larger ones more than one
            ring of a LiDAR hits a wall.
        max_thickness_m: a flat cell has at most this standard deviation along its normal.
    """
    toward = cloud.toward_origin().astype(np.float32)
    left = np.arange(len(cloud))
    for cell_m in cells_m:
        if not len(left):
            break
        # what was flat already still helps to tell what is flat around it
        normal, flat = _normals(cloud.points_m, toward, cell_m, max_thickness_m)
        rows = left[flat[left]]
        toward[rows] = normal[rows]
        left = left[~flat[left]]
    return toward


def _normals(
    points_m: Float[np.ndarray, "n 3"], toward: Float32[np.ndarray, "n 3"], cell_m: float, max_thickness_m: float
) -> tuple[Float32[np.ndarray, "n 3"], Bool[np.ndarray, "n"]]:
    """For every point the normal of its cell on its own side, and whether the cell is flat."""
    cell_of, count = _cells(points_m, cell_m)
    normal, thickness, width = _planes(points_m, cell_of, count, cell_m)
    flat = (count >= _MIN_POINTS) & (thickness <= max_thickness_m) & (width >= _MIN_FLATNESS * np.maximum(thickness, 1e-3))
    mean_toward = np.stack([np.bincount(cell_of, toward[:, a], len(count)) for a in range(3)], axis=1) / count[:, None]
    normal *= np.where((normal * mean_toward).sum(1) < 0, -1.0, 1.0)[:, None]
    own = normal.astype(np.float32)[cell_of]
    # a thin wall seen from both sides has points of both sides in one cell
    own[(own * toward).sum(1) < -_GRAZING] *= -1
    return own, flat[cell_of]


def _cells(points_m: Float[np.ndarray, "n 3"], cell_m: float) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "c"]]:
    """The cell of every point, and how many points each cell holds."""
    index = np.floor(points_m / cell_m).astype(np.int64)
    index -= index.min(0)
    size = index.max(0) + 1
    key = (index[:, 0] * size[1] + index[:, 1]) * size[2] + index[:, 2]
    _, cell_of, count = np.unique(key, return_inverse=True, return_counts=True)
    return cell_of, count


def _planes(
    points_m: Float[np.ndarray, "n 3"], cell_of: Int[np.ndarray, "n"], count: Int[np.ndarray, "c"], cell_m: float
) -> tuple[Float[np.ndarray, "c 3"], Float[np.ndarray, "c"], Float[np.ndarray, "c"]]:
    """Normal, and the standard deviations along the normal and along the narrower direction in the plane."""
    cells = len(count)
    # about the cell's own corner, so that the squares of world coordinates do not swallow the variance
    local = points_m - np.floor(points_m / cell_m) * cell_m
    mean = np.stack([np.bincount(cell_of, local[:, a], cells) for a in range(3)], axis=1) / count[:, None]
    scatter = np.empty((cells, 3, 3))
    for a in range(3):
        for b in range(a, 3):
            moment = np.bincount(cell_of, local[:, a] * local[:, b], cells) / count
            scatter[:, a, b] = scatter[:, b, a] = moment - mean[:, a] * mean[:, b]
    variance, axes = np.linalg.eigh(scatter)
    deviation = np.sqrt(np.maximum(variance, 0.0))
    return axes[:, :, 0], deviation[:, 0], deviation[:, 1]
