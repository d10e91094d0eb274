"""Light that comes back along a ray: sun with shadow, sky by orientation, reflections on paint and glass, haze."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from coin3d.town.mesh import Material
from coin3d.town.raycast import Hits, Moment
from coin3d.town.texture import ground_colour, noise, sky_colour, wall_colour

_CELL_M = 0.2
_REACH_M = 70.0


class ContactShade:
    """How dark the ground is under and beside road users: a blurred map of their footprints around a place."""

    def __init__(self, moment: Moment, centre_m: Float[np.ndarray, "2"]) -> None:
        self._low = np.asarray(centre_m, dtype=np.float32) - _REACH_M
        size = int(2 * _REACH_M / _CELL_M)
        image = np.zeros((size, size), dtype=np.uint8)
        boxes = moment.world.boxes(moment.time_s)
        near = np.abs(boxes.centre_m[:, :2] - centre_m).max(1) < _REACH_M + 8
        for corners, category in zip(boxes[near].corners()[:, :4, :2], boxes.labels[near], strict=True):
            middle = corners.mean(0)
            grid = (middle + (corners - middle) * 0.94 - self._low) / _CELL_M
            depth = 225 if category.startswith("vehicle.") and "cycle" not in category else 110
            cv2.fillConvexPoly(image, np.round(grid * 16).astype(np.int32), depth, cv2.LINE_AA, 4)
        self._light = 1 - cv2.GaussianBlur(image, (0, 0), 0.38 / _CELL_M).astype(np.float32) / 255

    def at(self, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
        """Share of the sky's light that reaches the ground."""
        grid = (xy - self._low) / _CELL_M
        cell = np.clip(grid.astype(np.int32), 0, len(self._light) - 1)
        return np.asarray(self._light[cell[:, 1], cell[:, 0]])


def shade(
    moment: Moment,
    contact: ContactShade,
    origin: Float[np.ndarray, "3"],
    rays: Float[np.ndarray, "n 3"],
    hits: Hits,
    pixel_rad: float,
) -> Float[np.ndarray, "n 3"]:
    """Linear radiance along rays.

    Args:
        moment: the town.
        contact: darkening around road users.
        origin: common origin of the rays, world frame.
        rays: (N, 3) directions, any length, as they were cast.
        hits: their first hits.
        pixel_rad: angle between neighbouring rays.
    """
    sky = moment.world.sky
    length = np.linalg.norm(rays, axis=1)
    unit = (rays / length[:, None]).astype(np.float32)
    radiance = np.empty((len(rays), 3), dtype=np.float32)
    air = hits.face < 0
    radiance[air] = sky_colour(sky, unit[air])
    rows = np.flatnonzero(~air)
    if not len(rows):
        return radiance

    unit, face = unit[rows], hits.face[rows]
    metres = hits.distance[rows] * length[rows].astype(np.float32)
    points = origin.astype(np.float32) + metres[:, None] * unit
    normal = moment.normal[face]
    facing = -(normal * unit).sum(1)
    normal = normal * np.where(facing < 0, np.float32(-1), np.float32(1))[:, None]
    facing = np.abs(facing)
    footprint = metres * np.float32(pixel_rad) / np.sqrt(np.maximum(facing, 0.02))
    material = moment.material[face]
    colour = moment.colour[face]
    ambient_share = np.ones(len(rows), dtype=np.float32)
    gloss = np.where(material == Material.PAINT, np.float32(0.05), np.float32(0))
    gloss[material == Material.GLASS] = 0.06

    ground = np.flatnonzero(material == Material.GROUND)
    if len(ground):
        xy = points[ground, :2]
        colour[ground] = ground_colour(moment.world.plan, xy, footprint[ground])
        ambient_share[ground] = contact.at(xy)
    wall = np.flatnonzero(material == Material.WALL)
    if len(wall):
        table = moment.world.walls[moment.wall[face[wall]]]
        colour[wall], glass = wall_colour(table, colour[wall], points[wall], footprint[wall])
        gloss[wall] = 0.12 * glass
    leaf = np.flatnonzero(material == Material.FOLIAGE)
    if len(leaf):
        p = points[leaf]
        # skewed axes, so that the lattice of the noise does not show
        a, b, c = p[:, 0] + 0.7 * p[:, 2], p[:, 1] - 0.6 * p[:, 0], p[:, 2] + 0.5 * p[:, 1]
        leaves = np.stack([noise(11 * a + 3 * b, 10 * c), noise(5 * b + 9, 5 * a), noise(9 * c + 2 * a, 12 * b)], -1)
        fade = (1 / (1 + (footprint[leaf] / 0.12) ** 2))[:, None]
        tilted = normal[leaf] + 1.7 * fade * (leaves - 0.5)
        normal[leaf] = tilted / np.linalg.norm(tilted, axis=1, keepdims=True)
        gaps = fade[:, 0] * (leaves.sum(1) - 1.5)
        colour[leaf] *= (1.35 + 0.9 * gaps)[:, None]
        ambient_share[leaf] = 0.9 + 0.5 * gaps

    sun_direction = sky.sun_direction.astype(np.float32)
    towards_sun = normal @ sun_direction
    lit = np.flatnonzero(towards_sun > 0)
    bright = np.zeros(len(rows), dtype=np.float32)
    if len(lit):
        # lift off the surface by more than the rounding of a hit far away
        start = points[lit] + normal[lit] * (0.004 + 2e-4 * metres[lit])[:, None]
        clear = ~moment.in_shadow(start, sky.sun_direction)
        bright[lit] = towards_sun[lit] * clear
    up = (0.5 + 0.5 * normal[:, 2])[:, None]
    ambient = (up * sky.ambient + (1 - up) * sky.bounce).astype(np.float32) * ambient_share[:, None]
    light = bright[:, None] * sky.sun.astype(np.float32) + ambient
    lamp = material == Material.LAMP
    light[lamp] = 0.6 * light[lamp] + 0.5
    out = colour * light

    shiny = np.flatnonzero(gloss > 0.004)
    if len(shiny):
        out[shiny] += _reflection(moment, unit[shiny], normal[shiny], facing[shiny], gloss[shiny], bright[shiny] > 0)
    haze = np.exp(-metres / np.float32(sky.haze_m))[:, None]
    far = (0.9 * sky.horizon).astype(np.float32)
    radiance[rows] = out * haze + far * (1 - haze)
    return radiance


def _reflection(
    moment: Moment,
    unit: Float[np.ndarray, "n 3"],
    normal: Float[np.ndarray, "n 3"],
    facing: Float[np.ndarray, "n"],
    gloss: Float[np.ndarray, "n"],
    sunlit: np.ndarray,
) -> Float[np.ndarray, "n 3"]:
    """Mirror image of sky, horizon and sun, stronger at grazing angles."""
    sky = moment.world.sky
    mirrored = unit + 2 * facing[:, None] * normal
    fresnel = gloss + (1 - gloss) * (1 - facing) ** 5 * np.minimum(gloss * 8, 0.8)
    t = np.clip(mirrored[:, 2:] * 2.5, 0, 1)
    above = sky.horizon.astype(np.float32) * (1 - t) + (0.6 * sky.zenith + 0.4 * sky.horizon).astype(np.float32) * t
    # near the horizon a street mirrors its own houses, below it the road
    street = (0.35 * sky.ambient).astype(np.float32)
    s = np.clip(mirrored[:, 2:] * 4 - 0.4, 0, 1)
    seen = street * (1 - s) + above * s
    towards = np.clip(mirrored @ sky.sun_direction.astype(np.float32), 0, 1)
    glint = np.where(sunlit, towards**90, 0)[:, None] * sky.sun.astype(np.float32) * 0.8
    return np.asarray(fresnel[:, None] * seen + glint * np.minimum(gloss * 10, 1)[:, None])


def developed(radiance: Float[np.ndarray, "... 3"], exposure: float) -> UInt8[np.ndarray, "... 3"]:
    """Tone curve and gamma: linear radiance to the 8-bit values of a photograph."""
    x = np.maximum(radiance * np.float32(1.25 * exposure), 0)
    curve = x * (1 + x / np.float32(5.0)) / (1 + x)
    return np.asarray(np.clip(np.power(curve, np.float32(0.47)) * np.float32(262) - np.float32(8), 0, 255).astype(np.uint8))
