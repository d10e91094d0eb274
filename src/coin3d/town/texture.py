"""Procedural surfaces, already averaged over the footprint of a pixel so that distance does not turn them into noise."""

from __future__ import annotations

from functools import cache

import numpy as np
from jaxtyping import Float, Int

from coin3d.town.plan import CELL_M, GroundPlan
from coin3d.town.sky import Sky

_TILE = 256


@cache
def _noise_tile() -> Float[np.ndarray, "s s"]:
    return np.random.default_rng(7).random((_TILE, _TILE), dtype=np.float32)


def hashed(a: Int[np.ndarray, "n"], b: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """A number in [0, 1) for every cell."""
    return np.asarray(_noise_tile()[a & (_TILE - 1), b & (_TILE - 1)])


def noise(x: Float[np.ndarray, "n"], y: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """Smooth noise in [0, 1) that changes over one unit."""
    fx, fy = np.floor(x), np.floor(y)
    u, v = x - fx, y - fy
    i, j = fx.astype(np.int32) & (_TILE - 1), fy.astype(np.int32) & (_TILE - 1)
    i1, j1 = (i + 1) & (_TILE - 1), (j + 1) & (_TILE - 1)
    tile = _noise_tile()
    return np.asarray((tile[i, j] * (1 - u) + tile[i1, j] * u) * (1 - v) + (tile[i, j1] * (1 - u) + tile[i1, j1] * u) * v)


def ground_colour(
    plan: GroundPlan, xy: Float[np.ndarray, "n 2"], footprint_m: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n 3"]:
    """Reflectance of the ground from the level of the plan that fits the footprint."""
    level = np.clip(np.round(np.log2(np.maximum(footprint_m, 1e-3) / CELL_M)), 0, len(plan.levels) - 1).astype(np.int32)
    colour = np.empty((len(xy), 3), dtype=np.float32)
    for k, image in enumerate(plan.levels):
        rows = np.flatnonzero(level == k)
        if not len(rows):
            continue
        size = len(image)
        grid = np.clip((xy[rows] + plan.half_extent_m) / (CELL_M * 2**k) - 0.5, 0, size - 1.001)
        cell = grid.astype(np.int32)
        weight = (grid - cell).astype(np.float32)
        flat = image.reshape(-1, 3)
        at = cell[:, 1] * size + cell[:, 0]
        u, v = weight[:, :1], weight[:, 1:]
        colour[rows] = (flat[at] * (1 - u) + flat[at + 1] * u) * (1 - v) + (
            flat[at + size] * (1 - u) + flat[at + size + 1] * u
        ) * v
    grain = noise(xy[:, 0] * 23, xy[:, 1] * 23) - 0.5
    colour *= (1 + 0.3 * grain / (1 + (footprint_m / 0.05) ** 2))[:, None]
    return (colour / 255) ** 2


def _covered(x: Float[np.ndarray, "n"], duty: Float[np.ndarray, "n"], width: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """Share of a window of ``width`` around x covered by pulses of ``duty`` centred in every unit interval."""

    def integral(t: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        whole = np.floor(t)
        return np.asarray(whole * duty + np.clip(t - whole - (1 - duty) / 2, 0, duty))

    half = np.clip(width, 0.02, 4.0) / 2
    return np.asarray((integral(x + half) - integral(x - half)) / (2 * half))


def wall_colour(
    walls: Float[np.ndarray, "n 14"],
    base: Float[np.ndarray, "n 3"],
    points: Float[np.ndarray, "n 3"],
    footprint_m: Float[np.ndarray, "n"],
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n"]]:
    """Reflectance of facades and the share of glass in each pixel; ``walls`` are rows of ``Wall.row``."""
    x0, y0, dx, dy, base_z, floor, bay, window_w, window_h, shop = (walls[:, k] for k in range(10))
    trim, seed = walls[:, 10:13], walls[:, 13]
    u = ((points[:, 0] - x0) * dx + (points[:, 1] - y0) * dy) / bay
    v = (points[:, 2] - base_z) / floor
    is_shop = (shop > 0) & (v < 1)
    wide, high = np.where(is_shop, shop, window_w), np.where(is_shop, 0.72, window_h)
    fu, fv = footprint_m / bay, footprint_m / floor
    glass = _covered(u, wide, fu) * _covered(v, high, fv) * (v > 0)
    frame = _covered(u, np.minimum(wide + 0.10, 1), fu) * _covered(v, np.minimum(high + 0.08, 1), fv)
    cross = _covered(u * 1.0 + 0.5, np.float32(0.025) * np.ones_like(u), fu)
    glass = glass * (1 - cross)
    cell = hashed(
        np.floor(u).astype(np.int32) + (seed * 251).astype(np.int32),
        np.floor(v).astype(np.int32) + (seed * 83).astype(np.int32),
    )
    far = np.clip(fu * 1.5, 0, 1)
    pane = 0.02 + 0.22 * ((1 - far) * cell**3 + far * 0.25)
    brick = noise(u * bay * 1.7, v * floor * 3.1) - 0.5
    plaster = base * (1 + 0.22 * brick / (1 + (footprint_m / 0.25) ** 2))[:, None]
    plinth = np.clip((0.12 - v) * 40, 0, 1)[:, None]
    colour = plaster * (1 - plinth) + trim * plinth
    edge = np.clip(frame - glass, 0, 1)[:, None]
    colour = colour * (1 - edge) + trim * edge
    g = glass[:, None]
    return (colour * (1 - g) + pane[:, None] * np.array([0.9, 1.0, 1.1], dtype=np.float32) * g).astype(np.float32), glass


def sky_colour(sky: Sky, rays: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Radiance of the sky along unit rays: gradient, clouds and a glow around the sun."""
    up = np.clip(rays[:, 2], 0.0, 1)
    t = np.sqrt(up)[:, None]
    colour = sky.horizon.astype(np.float32) * (1 - t) + sky.zenith.astype(np.float32) * t
    scale = 2.2 / (up + 0.12)
    x, y = rays[:, 0] * scale, rays[:, 1] * scale
    shape = 0.6 * noise(x + 31, y + 17) + 0.27 * noise(2.3 * x, 2.3 * y) + 0.13 * noise(5.1 * x, 5.1 * y)
    cover = np.clip((shape - (0.82 - 0.55 * sky.cloud)) * 4, 0, 1) * np.clip(up * 9, 0, 1) * 0.85
    white = (0.75 * sky.horizon + 0.25).astype(np.float32)
    colour = colour * (1 - cover[:, None]) + white * cover[:, None]
    towards = np.clip(rays @ sky.sun_direction.astype(np.float32), 0, 1)
    glow = 0.35 * towards**8 + 0.8 * towards**200
    return np.asarray(colour + glow[:, None] * (sky.sun * 0.25).astype(np.float32))
