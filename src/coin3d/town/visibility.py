"""How much of each road user the cameras of a rig can see."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from coin3d.geometry import Pose, Rig
from coin3d.town.raycast import Moment
from coin3d.town.world import placed

_SAMPLES = 48


def visible_share(moment: Moment, rig: Rig, world_from_ego: Pose, names: Sequence[str]) -> Float[np.ndarray, "n"]:
    """Share of points on each actor towards which a camera looks and first meets that actor.

    A point on the far side counts as seen when the near side is: the share compares what is left of the outline after
    other things have covered parts of it or the image has cut it off, like the visibility levels of nuScenes.
    """
    world = moment.world
    numbers = np.array([world.number_of[name] for name in names], dtype=np.int64)
    if not len(numbers):
        return np.zeros(0)
    points = np.stack([_surface_points(moment, int(n)) for n in numbers])
    ego_points = world_from_ego.inverse().apply(points)
    seen = np.zeros(points.shape[:2], dtype=bool)
    for camera in rig.values():
        row, column = np.nonzero(camera.sees(ego_points))
        if not len(row):
            continue
        origin = (world_from_ego @ camera.ego_from_cam).translation
        rays = points[row, column] - origin
        hits = moment.cast(np.broadcast_to(origin.astype(np.float32), rays.shape), rays)
        seen[row, column] |= (hits.face >= 0) & (moment.actor[np.maximum(hits.face, 0)] == numbers[row])
    return np.asarray(seen.mean(1))


def _surface_points(moment: Moment, number: int) -> Float[np.ndarray, "s 3"]:
    """Centres of faces, picked evenly by area."""
    mesh = placed(moment.world.actors[number - 1], moment.time_s, moment.world.terrain)
    corner = mesh.vertices[mesh.faces].astype(np.float64)
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    steps = (np.arange(_SAMPLES) + 0.5) / _SAMPLES * area.sum()
    pick = np.minimum(np.searchsorted(np.cumsum(area), steps), len(area) - 1)
    return np.asarray(corner[pick].mean(1))
