"""Closed meshes of objects that were seen from some sides only, without their convex hull.

The paper repairs object meshes with pymeshfix (AGPL), which patches boundary loops. Here the unseen part is decided in a grid
first and meshed once, so the result is closed by construction: a cell is inside if the object was seen on both sides of it.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from coin3d.geometry.mesh import TriangleMesh
from coin3d.scenes.enclosure import carved, enclosed
from coin3d.scenes.fuse import BLOCK_SIDE, Field, FusionSettings, fuse
from coin3d.scenes.ray_cloud import RayCloud

MIN_POINTS = 30
"""Objects seen by fewer points, the mirrored copy not counted, get no mesh."""
_MARGIN = 4
_LEAST_COMPONENT = 0.02
_SKIN = 0.35
_SMOOTHING = 0.7
_ANCHOR = 0.15


def object_voxel_m(size_m: Float[np.ndarray, "3"]) -> float:
    """Voxels of an object: a twelfth of its narrowest side, between 5 cm (pedestrians) and 10 cm (vehicles)."""
    return float(np.clip(np.min(size_m) / 12, 0.05, 0.1))


def close_object(rays: RayCloud, size_m: Float[np.ndarray, "3"], threads: int = 1) -> TriangleMesh:
    """A watertight mesh around what was seen of an object.

    Near seen surfaces the mesh is that of the fused field. Elsewhere a cell belongs to the object if it lies between seen
    parts (``enclosure.enclosed``), unless rays went through it. Cavities are filled; specks are dropped.

    Args:
        rays: in the box frame, with the mirrored copy.
        size_m: (3,) length, width, height of the box.
        threads: of the fusion.

    Returns:
        The mesh in the box frame; without faces if the points enclose nothing.
    """
    voxel_m = object_voxel_m(size_m)
    field = fuse(rays, FusionSettings(voxel_m, min_weight=1.0, spread=1), threads)
    half = np.ceil(size_m / 2 / voxel_m).astype(np.int64) + _MARGIN
    low, shape = -half, 2 * half
    known_m = _dense(field, low, shape)
    cell = np.floor(rays.points_m / voxel_m).astype(np.int64) - low
    cell = cell[((cell >= 0) & (cell < shape)).all(1)]
    seen = np.zeros(shape, dtype=bool)
    seen[tuple(cell.T)] = True
    within = _cells_of_box(size_m, voxel_m, low, shape)
    inside = enclosed(seen, within, carved(rays, voxel_m, low, shape) & ~seen, voxel_m)
    # the field tells what is in front of a surface; what lies behind it may be past an edge, so there the votes decide
    inside &= ~(known_m > 0)
    # rays that graze a lonely edge put all of it in front
    inside |= seen & ~ndimage.binary_dilation(inside, np.ones((3, 3, 3), dtype=bool))
    inside = _tidy(inside, cell)
    return _surface(inside, seen, known_m, low, voxel_m)


def _dense(field: Field, low: Int[np.ndarray, "3"], shape: Int[np.ndarray, "3"]) -> Float[np.ndarray, "x y z"]:
    """The part of a field in a grid of cells starting at ``low``; NaN where nothing is known."""
    first = low // BLOCK_SIDE
    blocks = (low + shape - 1) // BLOCK_SIDE - first + 1
    padded = np.full((*blocks, *[BLOCK_SIDE] * 3), np.nan, dtype=np.float32)
    at = field.coords - first
    rows = ((at >= 0) & (at < blocks)).all(1)
    padded[tuple(at[rows].T)] = field.distance_m[rows]
    whole = padded.transpose(0, 3, 1, 4, 2, 5).reshape(blocks * BLOCK_SIDE)
    start = low - first * BLOCK_SIDE
    part: np.ndarray = whole[tuple(slice(s, s + n) for s, n in zip(start, shape, strict=True))]
    return part


def _blocks(values: Float[np.ndarray, "x y z"], low: Int[np.ndarray, "3"], voxel_m: float) -> Field:
    """A grid of cells as a field."""
    first = low // BLOCK_SIDE
    blocks = (low + values.shape - 1) // BLOCK_SIDE - first + 1
    whole = np.full(blocks * BLOCK_SIDE, np.nan, dtype=np.float32)
    start = low - first * BLOCK_SIDE
    whole[tuple(slice(s, s + n) for s, n in zip(start, values.shape, strict=True))] = values
    x, y, z = blocks
    cut = whole.reshape(x, BLOCK_SIDE, y, BLOCK_SIDE, z, BLOCK_SIDE).transpose(0, 2, 4, 1, 3, 5)
    coords = np.stack(np.meshgrid(*[np.arange(n) for n in blocks], indexing="ij"), axis=-1).reshape(-1, 3) + first
    return Field(
        np.ascontiguousarray(coords, dtype=np.int32), np.ascontiguousarray(cut).reshape(-1, *[BLOCK_SIDE] * 3), voxel_m
    )


def _cells_of_box(
    size_m: Float[np.ndarray, "3"], voxel_m: float, low: Int[np.ndarray, "3"], shape: Int[np.ndarray, "3"]
) -> Bool[np.ndarray, "x y z"]:
    """Cells whose centre lies in the box."""
    sides = [np.abs((np.arange(n) + start + 0.5) * voxel_m) <= s / 2 for s, start, n in zip(size_m, low, shape, strict=True)]
    return np.asarray(sides[0][:, None, None] & sides[1][None, :, None] & sides[2][None, None, :])


def _tidy(inside: Bool[np.ndarray, "x y z"], cell: Int[np.ndarray, "n 3"]) -> Bool[np.ndarray, "x y z"]:
    """Without cavities, without parts that hold next to no points, and with a free rim."""
    inside = inside.copy()
    for axis in range(3):
        np.moveaxis(inside, axis, 0)[[0, -1]] = False
    inside = ndimage.binary_fill_holes(inside)
    labels, count = ndimage.label(inside)
    if count > 1:
        # points lie on the surface, in a cell of the part or beside it
        reach = ndimage.grey_dilation(labels, size=3)
        points = np.bincount(reach[tuple(cell.T)], minlength=count + 1)
        kept = points >= _LEAST_COMPONENT * len(cell)
        kept[0] = False
        inside = kept[labels]
    return np.asarray(inside)


def _surface(
    inside: Bool[np.ndarray, "x y z"],
    seen: Bool[np.ndarray, "x y z"],
    known_m: Float[np.ndarray, "x y z"],
    low: Int[np.ndarray, "3"],
    voxel_m: float,
) -> TriangleMesh:
    """The zero surface of the known field where it agrees with the cells, and of a smoothed distance to them elsewhere."""
    if not inside.any():
        return TriangleMesh.empty()
    cells = ndimage.distance_transform_edt(~inside) - ndimage.distance_transform_edt(inside)
    # half a cell from its centre to its side; and a surface runs through the outermost cell, not around it
    cells += _SKIN - 0.5 * np.sign(cells)
    agree = ~np.isnan(known_m) & ((known_m < 0) == inside)
    values = np.where(agree, known_m, voxel_m * cells)
    values = ndimage.gaussian_filter(np.clip(values, -3 * voxel_m, 3 * voxel_m), _SMOOTHING)
    # a line of points along an edge must not be smoothed away
    values = np.where(seen & inside, np.minimum(values, -_ANCHOR * voxel_m), values)
    for axis in range(3):
        np.moveaxis(values, axis, 0)[[0, -1]] = voxel_m
    return _blocks(values, low, voxel_m).surface()
