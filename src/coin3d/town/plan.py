"""The painted plan: what colour the ground has at every place, as an image pyramid, and what is built where."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from coin3d.town.layout import CROSSWALK_M, PARKING_M, Layout, Road
from coin3d.town.path import Path

CELL_M = 0.1
_SHIFT = 4
_COARSE = 4


@dataclass(frozen=True, eq=False)
class GroundPlan:
    """Ground colours.

    Args:
        half_extent_m: the plan covers [-half, half] in x and y; row 0 is y = -half.
        levels: image pyramid, level k with cells of ``CELL_M * 2**k``; the value is 255 sqrt(reflectance).
        asphalt: (rows, columns) mask of ``_COARSE`` cells: 255 on the carriageway.
        built: same grid: 255 on carriageway and pavement.
    """

    half_extent_m: float
    levels: tuple[UInt8[np.ndarray, "_ _ 3"], ...]
    asphalt: UInt8[np.ndarray, "r c"]
    built: UInt8[np.ndarray, "r c"]

    def covered(self, corners_m: Float[np.ndarray, "4 2"], margin_m: float = 0.0) -> bool:
        """Whether a rectangle touches carriageway or pavement, or leaves the plan."""
        cell = CELL_M * _COARSE
        grown = corners_m + margin_m * np.sign(corners_m - corners_m.mean(0))
        grid = np.round((grown + self.half_extent_m) / cell).astype(np.int32)
        if grid.min() < 0 or grid.max() >= len(self.built):
            return True
        low, high = grid.min(0), grid.max(0) + 1
        mask = np.zeros((high[1] - low[1], high[0] - low[0]), dtype=np.uint8)
        cv2.fillConvexPoly(mask, grid - low, 255)
        return bool((self.built[low[1] : high[1], low[0] : high[0]] & mask).any())

    def kerbs(self) -> list[Float[np.ndarray, "n 2"]]:
        """Outlines of the carriageway, closed, in metres."""
        contours, _ = cv2.findContours(self.asphalt, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        lines = []
        for contour in contours:
            points = contour[:, 0].astype(np.float64)
            if len(points) < 40:
                continue
            # the contour follows cells; a moving average makes it a smooth kerb
            kernel = np.ones(9) / 9
            wrapped = np.concatenate([points[-4:], points, points[:4]])
            smooth = np.stack([np.convolve(wrapped[:, k], kernel, mode="valid") for k in (0, 1)], axis=1)
            metres = (smooth[::4] + 0.5) * CELL_M * _COARSE - self.half_extent_m
            inside = (np.abs(metres) < self.half_extent_m - 2).all(1)
            lines += [part for part in np.split(metres, np.flatnonzero(~inside)) if len(part) > 3]
        return lines


class _Canvas:
    """Draws shapes given in metres into a mask with sub-pixel edges."""

    def __init__(self, half_extent_m: float) -> None:
        self.half_m = half_extent_m
        self.size = round(2 * half_extent_m / CELL_M)

    def _fixed(self, points_m: Float[np.ndarray, "n 2"]) -> np.ndarray:
        return np.round(((points_m + self.half_m) / CELL_M - 0.5) * (1 << _SHIFT)).astype(np.int32)

    def mask(self) -> UInt8[np.ndarray, "s s"]:
        return np.zeros((self.size, self.size), dtype=np.uint8)

    def band(self, mask: UInt8[np.ndarray, "s s"], path: Path, left_m: float, right_m: float) -> None:
        """Fill between two parallels of a path."""
        left, right = path.offset(left_m).points_m, path.offset(right_m).points_m
        # piece by piece, because a bent band is not convex
        for i in range(0, len(left) - 1, 8):
            piece = np.concatenate([left[i : i + 9], right[i : i + 9][::-1]])
            cv2.fillPoly(mask, [self._fixed(piece)], 255, cv2.LINE_AA, _SHIFT)

    def line(
        self, mask: UInt8[np.ndarray, "s s"], path: Path, left_m: float, width_m: float, stretches: list[tuple[float, float]]
    ) -> None:
        """Paint along a parallel of a path, over stretches [start, end] of its length."""
        for start, end in stretches:
            if end - start > 0.3:
                self.band(mask, path.part(start, end), left_m + width_m / 2, left_m - width_m / 2)


def paint_plan(layout: Layout, rng: np.random.Generator) -> GroundPlan:
    """Paint verges, pavements, carriageway and markings."""
    canvas = _Canvas(layout.half_extent_m)
    pavement, asphalt = canvas.mask(), canvas.mask()
    for road in layout.roads:
        canvas.band(asphalt, road.centre, road.half_m(1), -road.half_m(-1))
        canvas.band(pavement, road.centre, road.half_m(1) + road.pavement_m, -road.half_m(-1) - road.pavement_m)
    asphalt, pavement = _rounded(asphalt, 5.0), _rounded(pavement, 2.0)
    white, yellow = canvas.mask(), canvas.mask()
    yellow_centre = rng.random() < 0.4
    for index, road in enumerate(layout.roads):
        _markings(canvas, white, yellow if yellow_centre else white, road, rng, bool(index))

    grass = np.array([0.10, 0.15, 0.05]) * rng.uniform(0.7, 1.3) * np.array([rng.uniform(0.8, 1.5), 1, rng.uniform(0.8, 1.2)])
    if rng.random() < 0.4:
        grass = np.full(3, rng.uniform(0.2, 0.32)) * np.array([1.05, 1.0, 0.93])
    tile = np.full(3, rng.uniform(0.28, 0.48)) * np.array([1.0, rng.uniform(0.93, 1.0), rng.uniform(0.82, 1.0)])
    tar = np.full(3, rng.uniform(0.07, 0.17)) * np.array([1.0, 1.0, rng.uniform(0.98, 1.06)])
    image = np.empty((canvas.size, canvas.size, 3), dtype=np.uint8)
    image[:] = _code(grass)
    _blend(image, pavement, tile)
    _blend(image, asphalt, tar)
    _stain(image, rng, 10)
    worn = rng.uniform(0.65, 0.95)
    _blend(image, (cv2.bitwise_and(white, asphalt) * worn).astype(np.uint8), np.array([0.72, 0.72, 0.70]))
    if yellow_centre:
        _blend(image, (cv2.bitwise_and(yellow, asphalt) * worn).astype(np.uint8), np.array([0.75, 0.48, 0.06]))
    levels: list[np.ndarray] = [image]
    while len(levels) < 6:
        half = levels[-1].shape[0] // 2
        levels.append(cv2.resize(levels[-1], (half, half), interpolation=cv2.INTER_AREA))
    coarse = canvas.size // _COARSE
    masks = [
        (cv2.resize(m, (coarse, coarse), interpolation=cv2.INTER_AREA) > 127).astype(np.uint8) * 255
        for m in (asphalt, pavement)
    ]
    return GroundPlan(layout.half_extent_m, tuple(levels), masks[0], cv2.bitwise_or(masks[0], masks[1]))


def _code(reflectance: Float[np.ndarray, "3"]) -> UInt8[np.ndarray, "3"]:
    return np.asarray(np.round(255 * np.sqrt(np.clip(reflectance, 0, 1))).astype(np.uint8))


def _blend(image: UInt8[np.ndarray, "s s 3"], mask: UInt8[np.ndarray, "s s"], reflectance: Float[np.ndarray, "3"]) -> None:
    """Paint a colour in place, as strongly as the mask says; only touched cells are computed, because the plan is large."""
    at = np.flatnonzero(mask)
    weight = mask.ravel()[at].astype(np.uint16)[:, None]
    flat = image.reshape(-1, 3)
    flat[at] = (_code(reflectance) * weight + flat[at] * (255 - weight) + 127) // 255


def _stain(image: UInt8[np.ndarray, "s s 3"], rng: np.random.Generator, strength: float) -> None:
    """Large soft patches and fine grain, in place."""
    size = image.shape[0]
    total = np.zeros((size, size), dtype=np.float32)
    for cells, share in ((40, 0.6), (200, 0.5), (900, 0.5)):
        noise = rng.standard_normal((cells, cells), dtype=np.float32)
        total += share * strength * cv2.resize(noise, (size, size), interpolation=cv2.INTER_LINEAR)
    shift = np.clip(np.round(total), -60, 60)
    up, down = cv2.merge([np.maximum(shift, 0).astype(np.uint8)] * 3), cv2.merge([np.maximum(-shift, 0).astype(np.uint8)] * 3)
    cv2.add(image, up, dst=image)
    cv2.subtract(image, down, dst=image)


def _rounded(mask: UInt8[np.ndarray, "s s"], radius_m: float) -> UInt8[np.ndarray, "s s"]:
    """Round the inner corners where roads meet."""
    size = mask.shape[0]
    coarse = cv2.resize(mask, (size // _COARSE, size // _COARSE), interpolation=cv2.INTER_AREA)
    width = 2 * int(radius_m / (CELL_M * _COARSE)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (width, width))
    closed = cv2.GaussianBlur(cv2.morphologyEx(coarse, cv2.MORPH_CLOSE, disc), (5, 5), 0)
    soft = cv2.resize(closed, (size, size), interpolation=cv2.INTER_CUBIC)
    steeper = np.clip((np.arange(256) - 127.5) * 4 + 127.5, 0, 255).astype(np.uint8)
    return cv2.max(mask, cv2.LUT(soft, steeper))


def _open_stretches(road: Road, extra_m: float) -> list[tuple[float, float]]:
    """The road between its crossings."""
    edges = [0.0]
    for at, reach in road.crossings_m:
        edges += [max(0.0, at - reach - extra_m), min(road.centre.length_m, at + reach + extra_m)]
    edges.append(road.centre.length_m)
    return [(edges[i], edges[i + 1]) for i in range(0, len(edges), 2) if edges[i + 1] > edges[i] + 1]


def _dashes(stretches: list[tuple[float, float]], dash_m: float, gap_m: float) -> list[tuple[float, float]]:
    return [(s, min(s + dash_m, end)) for start, end in stretches for s in np.arange(start, end, dash_m + gap_m)]


def _markings(
    canvas: _Canvas, white: np.ndarray, centre: np.ndarray, road: Road, rng: np.random.Generator, is_side: bool
) -> None:
    free = _open_stretches(road, 0.4)
    if road.lanes > 1 or rng.random() < 0.4:
        canvas.line(centre, road.centre, 0.12, 0.11, free)
        canvas.line(centre, road.centre, -0.12, 0.11, free)
    else:
        canvas.line(centre, road.centre, 0.0, 0.14, _dashes(free, 3.0, 3.0))
    for side in (1, -1):
        for lane in range(1, road.lanes):
            canvas.line(white, road.centre, side * lane * road.lane_m, 0.13, _dashes(free, 3.0, 4.5))
        edge = road.lanes * road.lane_m
        if road.parking[0 if side > 0 else 1]:
            canvas.line(white, road.centre, side * edge, 0.12, free)
            ticks = [(s, s + 0.12) for start, end in free for s in np.arange(start + 4, end - 4, 6.2)]
            canvas.line(white, road.centre, side * (edge + PARKING_M / 2), PARKING_M, ticks)
        elif rng.random() < 0.6:
            canvas.line(white, road.centre, side * (edge - 0.3), 0.12, free)
    for at, reach in road.crossings_m:
        for sign in (-1, 1):
            stop, near = at + sign * reach, at + sign * (reach - CROSSWALK_M - 0.6)
            if not 3 < stop < road.centre.length_m - 3:
                continue
            # the stop line is for those who drive towards the crossing: right of the centre line in their direction
            towards = -1 if sign < 0 else 1
            canvas.line(
                white,
                road.centre,
                towards * road.lanes * road.lane_m / 2,
                road.lanes * road.lane_m - 0.2,
                [(stop - 0.2, stop + 0.2)],
            )
            walk = (min(near, near + sign * CROSSWALK_M), max(near, near + sign * CROSSWALK_M))
            for left in np.arange(-road.half_m(-1) + 0.5, road.half_m(1) - 0.3, 1.0):
                canvas.line(white, road.centre, left, 0.5, [walk])
