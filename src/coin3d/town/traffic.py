"""Fills the streets. Everybody keeps right; whoever would touch somebody at any time stays at home."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from coin3d.town.actors import Actor, Travel, overlap
from coin3d.town.catalogue import (
    Body,
    random_car,
    random_cyclist,
    random_motorcycle,
    random_moving,
    random_parked_bicycle,
    random_pedestrian,
    random_truck,
)
from coin3d.town.layout import CROSSWALK_M, PARKING_M, Layout, Road
from coin3d.town.options import TownOptions
from coin3d.town.path import Path, joined

EGO_SIZE_M = np.array([4.8, 2.0])
EGO_MIDDLE_M = 1.4
"""The ego body's middle is ahead of its rear axle."""


@dataclass(frozen=True, eq=False)
class EgoRoute:
    """Where the ego car's rear axle goes."""

    path: Path
    start_m: float
    travel: Travel

    def pose(self, time_s: Float[np.ndarray, "..."] | float) -> tuple[Float[np.ndarray, "... 2"], Float[np.ndarray, "..."]]:
        """Position (x, y) of the rear axle and heading."""
        s = self.start_m + self.travel.distance_m(time_s)
        rear, front = self.path.at(s), self.path.at(s + 2.7)
        return rear, np.asarray(np.arctan2(front[..., 1] - rear[..., 1], front[..., 0] - rear[..., 0]))


@dataclass
class Crowd:
    """The road users accepted so far (grown while filling the town)."""

    times_s: Float[np.ndarray, "t"]
    ego_xy: Float[np.ndarray, "t 2"]
    ego_yaw: Float[np.ndarray, "t"]
    actors: list[Actor] = field(default_factory=list)
    tracks: list[tuple[Float[np.ndarray, "t 2"], Float[np.ndarray, "t"], np.ndarray]] = field(default_factory=list)

    def try_add(
        self,
        body: Body,
        path: Path,
        start_m: float,
        travel: Travel,
        attribute: str,
        margin_m: float = 0.2,
        ahead_m: float = 0.0,
    ) -> bool:
        """Add unless it would come closer than ``margin_m`` (and ``ahead_m`` more along its heading) to anybody at any time."""
        actor = Actor(
            f"actor-{len(self.actors):04d}",
            body.category,
            body.size_m,
            path,
            start_m,
            travel,
            body.postures,
            1.5,
            attribute,
            body.half_base_m,
        )
        if not 0 <= start_m <= path.length_m:
            return False
        xy, yaw = actor.pose(self.times_s)
        size = body.size_m[:2] + margin_m + np.array([ahead_m, 0.0])
        there = actor.present(self.times_s)
        if (overlap(xy, yaw, size, self.ego_xy, self.ego_yaw, EGO_SIZE_M + 0.3) & there).any():
            return False
        for (other_xy, other_yaw, other_there), other in zip(self.tracks, self.actors, strict=True):
            reach = (np.hypot(*size) + np.hypot(*other.size_m[:2])) / 2
            near = there & other_there & (np.abs(xy - other_xy).max(1) < reach)
            if near.any() and overlap(xy[near], yaw[near], size, other_xy[near], other_yaw[near], other.size_m[:2]).any():
                return False
        self.actors.append(actor)
        self.tracks.append((xy, yaw, there))
        return True


def fill_streets(layout: Layout, options: TownOptions, rng: np.random.Generator) -> tuple[EgoRoute, tuple[Actor, ...]]:
    """The ego route and all road users."""
    ego, turning = _ego_route(layout, rng)
    times = np.arange(0, options.duration_s + 0.05, 0.1)
    rear, yaw = ego.pose(times)
    crowd = Crowd(times, rear + EGO_MIDDLE_M * np.stack([np.cos(yaw), np.sin(yaw)], -1), yaw)
    # own random streams, so that a factor on people does not change the cars
    street, kerb, walk = (np.random.default_rng(s) for s in rng.integers(0, 2**32, 3))
    gap = street.uniform(10, 26) / max(options.traffic, 1e-6)
    if options.traffic > 0:
        _stream(crowd, ego.path, ego.travel, gap, street)
        for road in layout.roads:
            _park(crowd, road, kerb.uniform(0.35, 0.92) * min(options.traffic, 1.1), kerb)
        for index, road in enumerate(layout.roads):
            _drive(crowd, road, gap, turning or index > 0, ego, street)
    for road in layout.roads:
        _people(crowd, road, options.people, walk)
    return ego, tuple(crowd.actors)


def _ego_route(layout: Layout, rng: np.random.Generator) -> tuple[EgoRoute, bool]:
    """Straight on along the main road, or turning into a side road."""
    main = layout.roads[0]
    lane_index = int(rng.integers(main.lanes))
    lane = main.lane(-1, lane_index)
    speed = rng.uniform(3.0, 10.0)
    swing = Travel(speed, 0.12 * speed, rng.uniform(0.4, 0.8))
    turn = rng.random() < 0.35
    for road in layout.roads[1:] if turn else ():
        joint, reach = road.crossings_m[0]
        at = main.centre.nearest_m(road.centre.at(joint))
        if not 120 < at < 240:
            continue
        main_reach = next(r for a, r in main.crossings_m if abs(a - at) < 2)
        right = rng.random() < 0.5
        target = road.lane(1 if right else -1, 0)
        begin = target.nearest_m(road.centre.at(joint + (-1 if right else 1) * (reach - 2.5)))
        if target.length_m - begin < 60:
            continue
        entry = lane.nearest_m(main.centre.at(at - main_reach + 3.0))
        path = joined(lane.part(0, entry), target.part(begin, target.length_m))
        speed = rng.uniform(3.0, 5.0)
        return EgoRoute(path, entry - rng.uniform(6, 18), Travel(speed, 0.1 * speed, 0.5)), True
    return EgoRoute(lane, lane.length_m / 2 - rng.uniform(15, 40), swing), False


def _stream(
    crowd: Crowd,
    path: Path,
    travel: Travel,
    gap_m: float,
    rng: np.random.Generator,
    start_m: float = 2.0,
    end_m: float = np.inf,
) -> None:
    """Vehicles one behind the other, all with the same motion, so that gaps stay."""
    s = start_m + rng.uniform(0, gap_m)
    while s < min(path.length_m, end_m) - 3:
        body = random_moving(rng)
        crowd.try_add(body, path, s + body.size_m[0] / 2, travel, _moving_attribute(body), 0.3, 5.0)
        s += body.size_m[0] + 5.0 + rng.exponential(gap_m)


def _moving_attribute(body: Body) -> str:
    return "cycle.with_rider" if body.category in ("vehicle.bicycle", "vehicle.motorcycle") else "vehicle.moving"


def _drive(crowd: Crowd, road: Road, gap_m: float, often_red: bool, ego: EgoRoute, rng: np.random.Generator) -> None:
    """Traffic in every lane: flowing, or waiting at a stop line with free flow behind the crossing."""
    for side in (-1, 1):
        red = rng.random() < (0.75 if often_red else 0.25)
        speed = rng.uniform(4, 11)
        for index in range(road.lanes):
            lane = road.lane(side, index)
            travel = Travel(speed * rng.uniform(0.9, 1.1), 0.1 * speed, rng.uniform(0.4, 0.8))
            begin = 2.0
            lights = (
                []
                if not red
                else [
                    (
                        lane.nearest_m(road.centre.at(at + side * (reach + 0.9))),
                        lane.nearest_m(road.centre.at(at - side * reach)),
                    )
                    for at, reach in road.crossings_m
                ]
            )
            for stop, beyond in sorted(lights):
                if stop > begin + 15:
                    _queue(crowd, lane, begin, stop, travel, gap_m, rng)
                begin = beyond
            _stream(crowd, lane, travel, gap_m, rng, begin)
        edge = -(road.lanes * road.lane_m - 0.3) if road.parking[0 if side > 0 else 1] else -(road.lanes * road.lane_m - 0.6)
        track = road.centre.offset(edge) if side < 0 else road.centre.reversed().offset(edge)
        pace = Travel(rng.uniform(3, 5.5))
        for s in rng.uniform(0, track.length_m, 5):
            crowd.try_add(random_cyclist(rng), track, s, pace, "cycle.with_rider", 0.15)


def _queue(
    crowd: Crowd, lane: Path, begin_m: float, stop_m: float, travel: Travel, gap_m: float, rng: np.random.Generator
) -> None:
    """Vehicles standing at, or braking towards, the end of a queue."""
    waiting = int(rng.integers(0, 5))
    front, s = stop_m, stop_m
    while s > begin_m + 6:
        body = random_moving(rng)
        half = body.size_m[0] / 2
        front -= half
        s = front if waiting > 0 else min(s - half - gap_m * rng.uniform(0.6, 2.2), front)
        waiting -= 1
        if s < begin_m:
            return
        still = front - s < 0.5
        motion = Travel(0.0) if still else Travel(travel.speed_mps, stop_after_m=front - s)
        attribute = "cycle.with_rider" if body.category in ("vehicle.bicycle", "vehicle.motorcycle") else "vehicle.stopped"
        crowd.try_add(body, lane, s, motion, attribute if still else _moving_attribute(body), 0.3)
        front -= half + rng.uniform(1.2, 2.8)
        s -= half


def _park(crowd: Crowd, road: Road, share: float, rng: np.random.Generator) -> None:
    """Parked vehicles along both kerbs, facing the way their side drives."""
    for side in (-1, 1):
        if not road.parking[0 if side > 0 else 1]:
            continue
        offset = -(road.lanes * road.lane_m + PARKING_M / 2)
        track = road.centre.offset(offset) if side < 0 else road.centre.reversed().offset(offset)
        s = rng.uniform(2, 8)
        while s < track.length_m - 4:
            kind = rng.random()
            body = random_car(rng) if kind < 0.92 else random_motorcycle(rng, False) if kind < 0.97 else random_truck(rng)
            middle = s + body.size_m[0] / 2
            on_centre = middle if side < 0 else road.centre.length_m * (1 - middle / track.length_m)
            if rng.random() < share and road.clear_of_crossings(on_centre, 3.5) and body.size_m[1] < PARKING_M + 0.05:
                still = track if rng.random() < 0.7 else track.offset(rng.uniform(-0.12, 0.1))
                attribute = "cycle.without_rider" if body.category == "vehicle.motorcycle" else "vehicle.parked"
                crowd.try_add(body, still, middle, Travel(0.0), attribute, 0.2)
            s += body.size_m[0] + rng.uniform(0.6, 2.0)


def _people(crowd: Crowd, road: Road, factor: float, rng: np.random.Generator) -> None:
    """Walkers and standers on the pavements, people on the crosswalks, bicycles leaning about."""
    for side in (-1, 1):
        half, width = road.half_m(side), road.pavement_m
        for _ in range(int(rng.poisson(factor * rng.uniform(0.04, 0.14) * road.centre.length_m))):
            track = road.centre.offset(side * (half + rng.uniform(0.9, width - 0.4)))
            track = track if rng.random() < 0.5 else track.reversed()
            walking = rng.random() < 0.75
            travel = Travel(rng.uniform(0.9, 1.7)) if walking else Travel(0.0)
            start = rng.uniform(3, track.length_m - 20)
            ways = [road.centre.nearest_m(track.at(start + travel.distance_m(t))) for t in (0.0, crowd.times_s[-1])]
            if any(min(ways) - 1 < at + reach - 5 and max(ways) + 1 > at - reach + 5 for at, reach in road.crossings_m):
                continue
            crowd.try_add(
                random_pedestrian(rng, walking),
                track,
                start,
                travel,
                "pedestrian.moving" if walking else "pedestrian.standing",
                0.2,
            )
        for s in rng.uniform(5, road.centre.length_m - 5, int(rng.poisson(2 * factor))):
            if road.clear_of_crossings(s, 2):
                track = road.centre.offset(side * (half + rng.uniform(0.9, 1.3)))
                crowd.try_add(random_parked_bicycle(rng), track, s, Travel(0.0), "cycle.without_rider", 0.15)
    for at, reach in road.crossings_m:
        for sign in (-1, 1):
            middle = at + sign * (reach - 0.6 - CROSSWALK_M / 2)
            if not 3 < middle < road.centre.length_m - 3:
                continue
            yaw = float(road.centre.yaw_at(middle))
            across = np.array([-np.sin(yaw), np.cos(yaw)])
            for _ in range(int(rng.poisson(1.6 * factor))):
                shift = rng.uniform(-1.2, 1.2) * np.array([np.cos(yaw), np.sin(yaw)])
                reach_m = road.widest_half_m + 18
                way = np.linspace(-reach_m, reach_m, 30)[:, None] * across * rng.choice([-1.0, 1.0])
                track = Path(road.centre.at(middle) + shift + way)
                start = rng.uniform(4, track.length_m - 16)
                crowd.try_add(
                    random_pedestrian(rng, True), track, start, Travel(rng.uniform(0.9, 1.6)), "pedestrian.moving", 0.5
                )
