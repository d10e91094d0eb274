"""The plan of the town: roads, crossings and lanes. Traffic keeps to the right."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from coin3d.town.path import Path

PARKING_M = 2.3
CROSSWALK_M = 3.0


@dataclass(frozen=True, eq=False)
class Road:
    """A street with the same cross-section all along.

    Args:
        centre: centre line.
        lanes: lanes per direction.
        lane_m: width of a lane.
        parking: parking strip along the left and the right kerb.
        pavement_m: width of the pavements.
        crossings_m: (position along the centre line, distance from it to the stop lines) of every crossing.
    """

    centre: Path
    lanes: int
    lane_m: float
    parking: tuple[bool, bool]
    pavement_m: float
    crossings_m: tuple[tuple[float, float], ...] = ()

    def half_m(self, side: int) -> float:
        """Centre line to kerb on the left (+1) or right (-1)."""
        return self.lanes * self.lane_m + PARKING_M * self.parking[0 if side > 0 else 1]

    @property
    def widest_half_m(self) -> float:
        return max(self.half_m(1), self.half_m(-1))

    def lane(self, side: int, index: int) -> Path:
        """Lane ``index`` (0 next to the centre line) in its driving direction: side -1 along the centre line, +1 against it."""
        path = self.centre.offset(side * self.lane_m * (index + 0.5))
        return path if side < 0 else path.reversed()

    def clear_of_crossings(self, s_m: float, margin_m: float) -> bool:
        """Whether a position is at least ``margin_m`` before or behind every stop line."""
        return all(abs(s_m - at) > reach + margin_m for at, reach in self.crossings_m)


@dataclass(frozen=True, eq=False)
class Layout:
    """The roads of a town; the first is the main road the ego car starts on.

    Args:
        roads: main road and side roads.
        half_extent_m: the plan is the square of this half width around the origin.
    """

    roads: tuple[Road, ...]
    half_extent_m: float


def build_layout(rng: np.random.Generator) -> Layout:
    """A main road of random bends with one to three side roads."""
    heading = rng.uniform(0, 2 * np.pi)
    centre = _bending_line(rng, heading, 340.0)
    main = _cross_section(rng, centre, lanes=int(rng.choice([1, 2], p=[0.6, 0.4])))
    count = int(rng.choice([1, 2, 3], p=[0.4, 0.4, 0.2]))
    positions = np.sort(rng.choice([-110.0, -35.0, 40.0, 115.0], size=count, replace=False)) + rng.uniform(-12, 12, count)
    if not ((positions > -20) & (positions < 75)).any():
        positions[-1] = rng.uniform(0, 60)
    sides: list[Road] = []
    marks: list[tuple[float, float, float]] = []
    for s in np.sort(positions):
        if marks and s - marks[-1][0] < 55:
            continue
        at = 170.0 + s
        side = _side_road(rng, main, at)
        reach_side = main.widest_half_m + 4.5 + CROSSWALK_M
        joint = side.centre.nearest_m(main.centre.at(at))
        sides.append(_with_crossings(side, ((joint, reach_side),)))
        marks.append((s, at, side.widest_half_m + 4.5 + CROSSWALK_M))
    main = _with_crossings(main, tuple((at, reach) for _, at, reach in marks))
    return Layout((main, *sides), 190.0)


def _with_crossings(road: Road, crossings: tuple[tuple[float, float], ...]) -> Road:
    return Road(road.centre, road.lanes, road.lane_m, road.parking, road.pavement_m, crossings)


def _cross_section(rng: np.random.Generator, centre: Path, lanes: int) -> Road:
    parking = (bool(rng.random() < 0.8), bool(rng.random() < 0.8))
    return Road(centre, lanes, float(rng.uniform(3.1, 3.7)), parking, float(rng.uniform(2.4, 4.5)))


def _bending_line(rng: np.random.Generator, heading_rad: float, length_m: float) -> Path:
    """Straight, a long bend or an S, about one point per metre, with the middle at the origin."""
    s = np.linspace(-length_m / 2, length_m / 2, int(length_m) + 1)
    kind = rng.random()
    if kind < 0.35:
        turn = np.zeros_like(s)
    elif kind < 0.7:
        turn = s * rng.choice([-1, 1]) / rng.uniform(150, 400)
    else:
        wave = rng.uniform(150, 260)
        turn = rng.uniform(0.12, 0.3) * np.sin(2 * np.pi * s / wave + rng.uniform(0, 2 * np.pi))
    angle = heading_rad + turn
    step = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = np.concatenate([np.zeros((1, 2)), np.cumsum((step[1:] + step[:-1]) / 2 * np.diff(s)[:, None], axis=0)])
    return Path(points - points[len(points) // 2])


def _side_road(rng: np.random.Generator, main: Road, at_m: float) -> Road:
    """A road across the main road, or ending at it from one side."""
    origin = main.centre.at(at_m)
    heading = main.centre.yaw_at(at_m) + np.pi / 2 + rng.uniform(-0.2, 0.2)
    bend = rng.choice([0.0, rng.uniform(-1, 1) / 200.0])
    kind = rng.choice(["across", "left", "right"], p=[0.6, 0.2, 0.2])
    arms: list[Float[np.ndarray, "n 2"]] = []
    for sign, present in ((-1.0, kind != "left"), (1.0, kind != "right")):
        reach = np.arange(0.0, 115.0 if present else 1.5)
        angle = heading + bend * np.maximum(0, reach - 15) * sign
        step = sign * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        arms.append(origin + np.concatenate([np.zeros((1, 2)), np.cumsum(step[:-1], axis=0)]))
    line = Path(np.concatenate([arms[0][::-1], arms[1][1:]]))
    road = _cross_section(rng, line, lanes=1 if main.lanes == 1 or rng.random() < 0.7 else 2)
    return road
