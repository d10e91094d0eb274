"""Worlds follow from their seed; traffic keeps right and nobody touches anybody."""

from __future__ import annotations

import numpy as np
import pytest

from coin3d.geometry import Boxes3D
from coin3d.town import TownOptions, World, build_world
from coin3d.town.actors import Actor, Travel, overlap
from coin3d.town.traffic import EGO_MIDDLE_M, EGO_SIZE_M

VEHICLES = ("vehicle.car", "vehicle.truck", "vehicle.bus.rigid")


def test_same_seed_same_world(world: World, hilly: World) -> None:
    again = build_world(3)
    np.testing.assert_array_equal(again.static.vertices, world.static.vertices)
    np.testing.assert_array_equal(again.plan.levels[0], world.plan.levels[0])
    np.testing.assert_array_equal(again.boxes(7.3).centre_m, world.boxes(7.3).centre_m)
    np.testing.assert_array_equal(again.moving_mesh(7.3)[0].vertices, world.moving_mesh(7.3)[0].vertices)
    assert len(hilly.static.vertices) != len(world.static.vertices)


@pytest.mark.parametrize("time_s", [0.0, 3.7, 11.0])
def test_nobody_touches_anybody(world: World, time_s: float) -> None:
    boxes = world.boxes(time_s)
    one = np.ones(1)
    for i in range(len(boxes)):
        for j in range(i):
            near = np.linalg.norm(boxes.centre_m[i, :2] - boxes.centre_m[j, :2]) < 13
            assert (
                not near
                or not overlap(
                    boxes.centre_m[i : i + 1, :2],
                    boxes.yaw_rad[i] * one,
                    boxes.size_m[i, :2],
                    boxes.centre_m[j : j + 1, :2],
                    boxes.yaw_rad[j] * one,
                    boxes.size_m[j, :2],
                ).any()
            ), (boxes.instance_ids[i], boxes.instance_ids[j])


def test_nobody_touches_the_ego(world: World) -> None:
    for time_s in np.arange(0, 12, 0.5):
        xy, yaw = world.ego.pose(time_s)
        middle = xy + EGO_MIDDLE_M * np.array([np.cos(yaw), np.sin(yaw)])
        ego = Boxes3D.create([[*middle, 1.0]], [[*EGO_SIZE_M, 2.0]], [yaw], ["ego"])
        boxes = world.boxes(time_s)
        for i in range(len(boxes)):
            assert not overlap(
                ego.centre_m[:, :2],
                ego.yaw_rad,
                EGO_SIZE_M,
                boxes.centre_m[i : i + 1, :2],
                boxes.yaw_rad[i : i + 1],
                boxes.size_m[i, :2],
            ).any()


@pytest.mark.parametrize("time_s", [0.0, 6.0])
def test_traffic_keeps_to_the_right(world: World, time_s: float) -> None:
    main = world.layout.roads[0]
    checked = 0
    boxes = world.boxes(time_s)
    for i in np.flatnonzero(np.isin(boxes.labels, VEHICLES)):
        s = main.centre.nearest_m(boxes.centre_m[i, :2])
        along = float(main.centre.yaw_at(s))
        offset = boxes.centre_m[i, :2] - main.centre.at(s)
        left = -np.sin(along) * offset[0] + np.cos(along) * offset[1]
        if abs(left) > main.widest_half_m or not main.clear_of_crossings(s, 2.0):
            continue
        with_road = np.cos(boxes.yaw_rad[i] - along)
        assert abs(with_road) > 0.95
        assert with_road * left < 0, "who drives along the centre line is right of it"
        checked += 1
    assert checked >= 8


def test_braking_ends_at_the_stop_without_going_back() -> None:
    distance = Travel(9.0, stop_after_m=30.0).distance_m(np.linspace(0, 12, 200))
    assert (np.diff(distance) >= -1e-9).all()
    assert distance[-1] == pytest.approx(30.0)
    assert Travel(9.0, stop_after_m=1.0).distance_m(12.0) == pytest.approx(1.0)


def test_boxes_stand_on_hilly_ground(hilly: World) -> None:
    boxes = hilly.boxes(1.0)
    bottom = boxes.centre_m[:, 2] - boxes.size_m[:, 2] / 2
    np.testing.assert_allclose(bottom, hilly.terrain.height_m(boxes.centre_m[:, :2]), atol=1e-9)
    assert np.ptp(bottom) > 0.5
    pose = hilly.world_from_ego(1.0)
    assert pose.translation[2] == pytest.approx(float(hilly.terrain.height_m(pose.translation[:2])))
    assert pose.rotation[2, 2] > 0.99


def test_velocity_is_that_of_the_motion(world: World) -> None:
    before, after = world.boxes(4.0), world.boxes(4.5)
    speed = np.linalg.norm(before.velocity_mps, axis=1)
    moved = dict(zip(after.instance_ids, after.centre_m, strict=True))
    for i, name in enumerate(before.instance_ids):
        if name in moved:
            assert np.linalg.norm(moved[name] - before.centre_m[i]) / 0.5 == pytest.approx(speed[i], abs=1.2)
    assert (speed > 3).sum() >= 3


def test_options_say_what_is_wrong() -> None:
    with pytest.raises(ValueError, match="duration_s"):
        TownOptions(duration_s=0)
    with pytest.raises(ValueError, match="factors"):
        TownOptions(traffic=-1)
    with pytest.raises(ValueError, match="seed"):
        build_world(-1)


def test_still_actors_never_move(world: World) -> None:
    still: list[Actor] = [a for a in world.actors if a.is_still]
    assert len(still) > 10
    for actor in still:
        np.testing.assert_array_equal(actor.pose(0.0)[0], actor.pose(11.0)[0])
