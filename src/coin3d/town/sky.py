"""Light and weather."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, eq=False)
class Sky:
    """The light of a scene, all colours linear.

    Args:
        sun_direction: (3,) unit vector to the sun.
        sun: (3,) irradiance of the sun on a surface facing it.
        zenith, horizon: (3,) radiance of the sky overhead and low down.
        ambient: (3,) light from the sky on a level surface.
        bounce: (3,) light from the ground on a surface facing down.
        cloud: share of clouds in [0, 1].
        haze_m: distance over which haze takes 63 % of the contrast.
        exposure: factor before the tone curve.
    """

    sun_direction: Float[np.ndarray, "3"]
    sun: Float[np.ndarray, "3"]
    zenith: Float[np.ndarray, "3"]
    horizon: Float[np.ndarray, "3"]
    ambient: Float[np.ndarray, "3"]
    bounce: Float[np.ndarray, "3"]
    cloud: float
    haze_m: float
    exposure: float


def random_sky(rng: np.random.Generator) -> Sky:
    """Clear, hazy, overcast or evening light with a random sun and tint."""
    kind = rng.choice(["clear", "hazy", "overcast", "evening"], p=[0.4, 0.25, 0.2, 0.15])
    azimuth = rng.uniform(0, 2 * np.pi)
    elevation = np.deg2rad(rng.uniform(10, 20) if kind == "evening" else rng.uniform(25, 65))
    tint = rng.uniform(0.94, 1.06, 3)
    blue, grey = np.array([0.22, 0.42, 0.80]), np.array([0.72, 0.75, 0.78])
    look = {
        "clear": (np.array([2.5, 2.35, 2.1]), blue, np.array([0.70, 0.80, 0.92]), 0.55, 900.0, rng.uniform(0.1, 0.5)),
        "hazy": (
            np.array([1.7, 1.6, 1.45]),
            0.5 * (blue + grey),
            np.array([0.85, 0.87, 0.88]),
            0.7,
            320.0,
            rng.uniform(0.3, 0.8),
        ),
        "overcast": (np.array([0.25, 0.25, 0.25]), 0.85 * grey, np.array([0.82, 0.83, 0.84]), 1.15, 450.0, 0.9),
        "evening": (
            np.array([2.2, 1.45, 0.8]),
            np.array([0.26, 0.36, 0.62]),
            np.array([0.98, 0.72, 0.48]),
            0.5,
            600.0,
            rng.uniform(0.2, 0.7),
        ),
    }[str(kind)]
    sun, zenith, horizon, level, haze, cloud = look
    ambient = level * (0.6 * zenith + 0.4 * horizon)
    direction = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    bounce = 0.22 * (ambient + sun * np.sin(elevation) * 0.6)
    return Sky(
        direction,
        sun * tint,
        zenith * tint,
        horizon * tint,
        ambient * tint,
        bounce * tint,
        float(cloud),
        float(haze * rng.uniform(0.7, 1.4)),
        float(rng.uniform(0.85, 1.15)) * (1.0 if kind != "overcast" else 1.05),
    )
