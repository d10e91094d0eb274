"""Fusion in plain float64 Python, one voxel at a time: what the native code must equal. For tests; it is slow."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

Voxel = tuple[int, int, int]


def fuse_reference(
    points_m: Float[np.ndarray, "n 3"],
    toward: Float[np.ndarray, "n 3"],
    voxel_m: float,
    truncation_m: float,
    spread: int = 0,
    weight: Float[np.ndarray, "n"] | None = None,
) -> dict[Voxel, tuple[float, float]]:
    """Mean distance in metres and weight of every voxel that a point reaches.

    A point changes one voxel in each layer across the main axis of its direction: the one that the line through the point
    passes, where the layer's centres are within the truncation along the line; and its neighbours within ``spread`` in that
    layer at weight 1 / (1 + squared offset). The distance is that of the voxel's centre along the direction, and voxels
    farther than the truncation are left alone.
    """
    per_voxel, truncation = 1.0 / voxel_m, truncation_m / voxel_m
    sums: dict[Voxel, tuple[float, float]] = {}
    for i, (point, direction) in enumerate(zip(points_m, toward, strict=True)):
        p, d = [float(x) * per_voxel for x in point], [float(x) for x in direction]
        a = max(range(3), key=lambda axis: abs(d[axis]))
        b, c = (a + 1) % 3, (a + 2) % 3
        reach = truncation * abs(d[a])
        for layer in range(math.ceil(p[a] - reach - 0.5), math.floor(p[a] + reach - 0.5) + 1):
            along = layer + 0.5 - p[a]
            middle_b, middle_c = math.floor(p[b] + along / d[a] * d[b]), math.floor(p[c] + along / d[a] * d[c])
            for ob in range(-spread, spread + 1):
                for oc in range(-spread, spread + 1):
                    vb, vc = middle_b + ob, middle_c + oc
                    distance = along * d[a] + (vb + 0.5 - p[b]) * d[b] + (vc + 0.5 - p[c]) * d[c]
                    if abs(distance) > truncation:
                        continue
                    w = (1.0 if weight is None else float(weight[i])) / (1 + ob * ob + oc * oc)
                    index = {a: layer, b: vb, c: vc}
                    voxel = (index[0], index[1], index[2])
                    old_sum, old_weight = sums.get(voxel, (0.0, 0.0))
                    sums[voxel] = (old_sum + w * distance, old_weight + w)
    return {voxel: (total / w * voxel_m, w) for voxel, (total, w) in sums.items() if w > 0}
