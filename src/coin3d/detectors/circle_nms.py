"""Suppression by the distance of centres, seen from above."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int


def circle_nms(
    place_m: Float[np.ndarray, "n 2"], scores: Float[np.ndarray, "n"], squared_distance_m2: float
) -> Int[np.ndarray, "k"]:
    """Rows kept, best score first: a place goes when its squared distance to a better kept one is at most the given.

    Rows whose score or place is not a number are never kept.
    """
    known = np.isfinite(scores) & np.isfinite(place_m).all(1)
    waiting = np.argsort(-scores, kind="stable")
    waiting = waiting[known[waiting]]
    kept = []
    while len(waiting):
        best, waiting = waiting[0], waiting[1:]
        kept.append(best)
        waiting = waiting[((place_m[waiting] - place_m[best]) ** 2).sum(1) > squared_distance_m2]
    return np.asarray(kept, dtype=np.int64)
