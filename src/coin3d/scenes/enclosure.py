"""Which cells of an object's grid lie inside it, judged from the cells where it was seen."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from coin3d.scenes.ray_cloud import RayCloud

# LiDAR rings leave gaps of this height on an object that keeps its distance
_RING_GAP_M = 0.6
# an end of the box with nothing seen in this share of its length was not seen at all
_UNSEEN_END = 0.15
_MAX_CARVING_RAYS = 30_000


def enclosed(
    seen: Bool[np.ndarray, "x y z"], within: Bool[np.ndarray, "x y z"], free: Bool[np.ndarray, "x y z"], voxel_m: float
) -> Bool[np.ndarray, "x y z"]:
    """Cells inside the object.

    Each axis votes for the cells between two seen ones. Upwards a cell needs something seen above it only, since nobody looks
    at an object from below; it must not lie under the lowest cell seen in its slice along the object. An end of the box at
    which nothing was seen counts as seen, so that a car followed from behind has a front. One vote is enough where no ray
    went through; the vertical vote together with a horizontal one also overrules rays, which come in through windows.

    Args:
        seen: cells with a surface.
        within: cells of the box.
        free: cells that rays went through.
        voxel_m: side of a cell.
    """
    length_rows = np.flatnonzero(within.any((1, 2)))
    first, last = int(length_rows[0]), int(length_rows[-1])
    end = max(1, round(_UNSEEN_END * (last - first + 1)))
    rear, front = _before(seen, 0), _before(seen[::-1], 0)[::-1]
    if not seen[: first + end].any():
        rear = rear | (within & (np.arange(len(seen)) >= first)[:, None, None])
    if not seen[last + 1 - end :].any():
        front = front | within
    along = rear & front
    across = _before(seen, 1) & _before(seen[:, ::-1], 1)[:, ::-1]
    under = _before(seen[:, :, ::-1], 2)[:, :, ::-1] & (np.arange(seen.shape[2]) >= _floor(seen)[:, None])[:, None, :]
    sure = under & (along | across)
    inside = sure | ((along | across | under) & ~free)
    gap = 1 + 2 * int(np.ceil(_RING_GAP_M / voxel_m / 2))
    for axis in (2, 0):
        inside |= _closed_along(inside, axis, gap) & ~free
    return inside | seen


def carved(
    rays: RayCloud, voxel_m: float, low: Int[np.ndarray, "3"], shape: Int[np.ndarray, "3"]
) -> Bool[np.ndarray, "x y z"]:
    """Cells that two or more rays went through on their way to the object, at least two cells before they hit it."""
    stride = max(1, len(rays) // _MAX_CARVING_RAYS)
    thinned = rays[::stride]
    counts = np.zeros(int(np.prod(shape)), dtype=np.int64)
    toward = thinned.toward_origin()
    reach_m = np.minimum(voxel_m * float(np.linalg.norm(shape)), thinned.range_m())
    for step in range(3, int(np.linalg.norm(shape)) + 1):
        going = reach_m > step * voxel_m
        if not going.any():
            break
        cell = np.floor(thinned.points_m[going] / voxel_m + step * toward[going]).astype(np.int64) - low
        inside = ((cell >= 0) & (cell < shape)).all(1)
        # inside the grid a ray stays inside until it leaves for good
        alive = np.flatnonzero(going)[~inside]
        reach_m[alive] = 0.0
        counts += np.bincount(np.ravel_multi_index(tuple(cell[inside].T), tuple(shape)), minlength=len(counts))
    return np.asarray((counts >= 2).reshape(shape))


def _before(mask: Bool[np.ndarray, "x y z"], axis: int) -> Bool[np.ndarray, "x y z"]:
    """Cells with a marked one at them or before them along an axis."""
    return np.asarray(np.logical_or.accumulate(mask, axis=axis))


def _floor(seen: Bool[np.ndarray, "x y z"]) -> Int[np.ndarray, "x"]:
    """For every slice along the object the lowest seen row; slices without take it from the nearest with."""
    profile = seen.any(1)
    rows = np.flatnonzero(profile.any(1))
    if not len(rows):
        return np.zeros(len(seen), dtype=np.int64)
    lowest = profile[rows].argmax(1)
    nearest = np.abs(np.arange(len(seen))[:, None] - rows).argmin(1)
    return np.asarray(lowest[nearest])


def _closed_along(mask: Bool[np.ndarray, "x y z"], axis: int, length: int) -> Bool[np.ndarray, "x y z"]:
    """Gaps shorter than ``length`` cells along one axis filled."""
    shape = [1, 1, 1]
    shape[axis] = length
    closed = ndimage.binary_closing(np.pad(mask, length), np.ones(shape, dtype=bool))
    inner = slice(length, -length)
    return np.asarray(closed[inner, inner, inner])
