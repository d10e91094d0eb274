"""A town at any moment: the one object cameras, LiDARs and recordings look at."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from coin3d.geometry import Boxes3D, Pose
from coin3d.town.actors import Actor
from coin3d.town.buildings import build_buildings
from coin3d.town.layout import Layout, build_layout
from coin3d.town.mesh import Mesh
from coin3d.town.options import TownOptions
from coin3d.town.plan import GroundPlan, paint_plan
from coin3d.town.scenery import draped, ground_mesh, kerb_mesh, street_furniture
from coin3d.town.sky import Sky, random_sky
from coin3d.town.terrain import Terrain
from coin3d.town.traffic import EgoRoute, fill_streets


@dataclass(frozen=True, eq=False)
class World:
    """A town built from a seed. Nothing in it depends on the rig that looks at it.

    Args:
        seed, options: what it was built from.
        layout, terrain, plan, sky: its parts.
        ego: route of the recording car.
        actors: all road users; an actor's number in images is its index here plus one.
        static: everything that never moves, standing actors included.
        static_actor: for every static face the number of its actor, 0 for none.
        walls: facade table the shader reads.
    """

    seed: int
    options: TownOptions
    layout: Layout
    terrain: Terrain
    plan: GroundPlan
    sky: Sky
    ego: EgoRoute
    actors: tuple[Actor, ...]
    static: Mesh
    static_actor: Int[np.ndarray, "f"]
    walls: Float[np.ndarray, "w 14"]

    def world_from_ego(self, time_s: float) -> Pose:
        """Pose of the ego car: origin under the rear axle on the ground."""
        xy, yaw = self.ego.pose(time_s)
        return self.terrain.standing(float(xy[0]), float(xy[1]), float(yaw))

    def boxes(self, time_s: float) -> Boxes3D:
        """All road users in town, in the world frame, labelled with nuScenes categories."""
        present = [a for a in self.actors if a.present(time_s)]
        if not present:
            return Boxes3D.empty()
        poses = [a.pose(time_s) for a in present]
        xy = np.array([p[0] for p in poses])
        size = np.array([a.size_m for a in present])
        z = self.terrain.height_m(xy) + size[:, 2] / 2
        step = 0.05
        ahead = np.array([a.pose(time_s + step)[0] for a in present])
        return Boxes3D.create(
            np.column_stack([xy, z]),
            size,
            [float(p[1]) for p in poses],
            [a.category for a in present],
            velocity_mps=(ahead - xy) / step,
            instance_ids=[a.name for a in present],
        )

    @cached_property
    def number_of(self) -> dict[str, int]:
        """Actor name -> its number in images."""
        return {a.name: i + 1 for i, a in enumerate(self.actors)}

    def moving_mesh(self, time_s: float) -> tuple[Mesh, Int[np.ndarray, "f"]]:
        """The moving actors in the world frame, with the actor number of every face."""
        meshes, numbers = [], []
        for number, actor in enumerate(self.actors, 1):
            if not actor.is_still and bool(actor.present(time_s)):
                meshes.append(placed(actor, time_s, self.terrain))
                numbers.append(np.full(len(meshes[-1].faces), number, dtype=np.int32))
        return Mesh.merge(meshes), np.concatenate(numbers) if numbers else np.zeros(0, dtype=np.int32)


def placed(actor: Actor, time_s: float, terrain: Terrain) -> Mesh:
    """An actor's mesh in the world frame; on a slope the body follows the ground, the box stays upright."""
    xy, yaw = actor.pose(time_s)
    return draped(actor.posture(time_s).moved((float(xy[0]), float(xy[1]), 0.0), float(yaw)), terrain)


def build_world(seed: int, options: TownOptions | None = None) -> World:
    """Build a town; the same seed and options always give the same one.

    Raises:
        ValueError: a negative seed.
    """
    if seed < 0:
        raise ValueError(f"a town's seed is 0 or more, got {seed}")
    options = options or TownOptions()
    # one stream per part: changing how one part draws leaves the others as they were
    plan_rng, paint_rng, house_rng, thing_rng, crowd_rng, sky_rng, hill_rng = (
        np.random.default_rng([seed, part]) for part in range(7)
    )
    layout = build_layout(plan_rng)
    terrain = Terrain.hilly(hill_rng) if options.slope else Terrain.flat()
    plan = paint_plan(layout, paint_rng)
    built = build_buildings(layout, plan, terrain, house_rng)
    ego, actors = fill_streets(layout, options, crowd_rng)
    parts = [
        ground_mesh(layout, terrain),
        *built.meshes,
        kerb_mesh(plan, terrain, thing_rng),
        street_furniture(layout, plan, built, terrain, thing_rng),
    ]
    numbers = [np.zeros(sum(len(m.faces) for m in parts), dtype=np.int32)]
    for number, actor in enumerate(actors, 1):
        if actor.is_still:
            parts.append(placed(actor, 0.0, terrain))
            numbers.append(np.full(len(parts[-1].faces), number, dtype=np.int32))
    return World(
        seed,
        options,
        layout,
        terrain,
        plan,
        random_sky(sky_rng),
        ego,
        actors,
        Mesh.merge(parts),
        np.concatenate(numbers),
        built.wall_table(),
    )
