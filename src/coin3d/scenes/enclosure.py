"""Which cells of an object's grid lie inside it, judged from the cells where it was seen."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int
from scipy import ndimage

from coin3d.scenes.ray_cloud import RayCloud

# gaps along the object that are closed: at most this long, and this share of its length
_GAP_M, _GAP_SHARE = 0.6, 0.3
# an end of the box counts as seen if the last share of its length holds this share of the seen cells
_END, _SEEN_END = 0.15, 0.05
# people and riders do not fill their boxes
_SHORTEST_BODY_M = 2.5
# wheels reach the ground, bodies do not: nothing is added under the sill, which is in the lowest share of the height
_SILL = 0.15
_MAX_CARVING_RAYS = 30_000


def enclosed(
    seen: Bool[np.ndarray, "x y z"], within: Bool[np.ndarray, "x y z"], free: Bool[np.ndarray, "x y z"], voxel_m: float
) -> Bool[np.ndarray, "x y z"]:
    """Cells inside the object.

    Each axis votes for the cells between two seen ones. Upwards a cell needs something seen above it only, since nobody looks
    at an object from below; the bottom is where the lowest parts were seen, wheels not counted. An end of the box at which
    next to nothing was seen counts as seen, so that a car followed from behind has a front. One vote is enough where no ray
    went through; the vertical vote together with a horizontal one also overrules rays, which come in through windows. In the
    end what is below a cell inside is inside too: rings of a LiDAR are a metre apart on a far truck.

    Args:
        seen: cells with a surface.
        within: cells of the box.
        free: cells that rays went through.
        voxel_m: side of a cell.
    """
    rows = np.flatnonzero(within.any((1, 2)))
    first, last = int(rows[0]), int(rows[-1])
    end, enough = max(1, round(_END * len(rows))), _SEEN_END * seen.sum()
    behind, ahead = _before(seen, 0), _before(seen[::-1], 0)[::-1]
    if len(rows) * voxel_m >= _SHORTEST_BODY_M:
        behind = behind | within if seen[: first + end].sum() < enough else behind
        ahead = ahead | within if seen[last + 1 - end :].sum() < enough else ahead
    along = behind & ahead
    across = _before(seen, 1) & _before(seen[:, ::-1], 1)[:, ::-1]
    under = _below(seen)
    inside = (under & (along | across)) | ((along | across | under) & ~free)
    inside |= _closed_along(inside, 1 + round(min(_GAP_M / voxel_m, _GAP_SHARE * len(rows)))) & ~free
    inside |= _below(inside) & ~free
    inside[:, :, : _sill(seen, within)] = False
    return np.asarray(inside | seen)


def carved(rays: RayCloud, voxel_m: float, low: Int[np.ndarray, "3"], shape: Int[np.ndarray, "3"]) -> Bool[np.ndarray, "x y z"]:
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


def _below(mask: Bool[np.ndarray, "x y z"]) -> Bool[np.ndarray, "x y z"]:
    """Cells with a marked one at them or above them."""
    return _before(mask[:, :, ::-1], 2)[:, :, ::-1]


def _sill(seen: Bool[np.ndarray, "x y z"], within: Bool[np.ndarray, "x y z"]) -> int:
    """The layer where the body begins: above the lowest seen one in most slices along the object, unless that is too high."""
    profile = np.asarray(seen.any(1))
    layers = np.flatnonzero(within.any((0, 1)))
    highest = int(layers[0]) + round(_SILL * len(layers))
    lowest = profile[np.asarray(profile.any(1))].argmax(1)
    return min(int(np.median(lowest)) + 1, highest) if len(lowest) else highest


def _closed_along(mask: Bool[np.ndarray, "x y z"], length: int) -> Bool[np.ndarray, "x y z"]:
    """Gaps of fewer than ``length`` cells along the object filled."""
    closed = ndimage.binary_closing(np.pad(mask, ((length, length), (0, 0), (0, 0))), np.ones((length, 1, 1), dtype=bool))
    return np.asarray(closed[length:-length])
