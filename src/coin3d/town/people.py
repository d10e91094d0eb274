"""Pedestrians, cyclists and motorcyclists. Body frame: x forward, y left, z up, origin on the ground."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from coin3d.town.car_bodies import HEADLIGHT, RUBBER, TAILLIGHT, TRIM
from coin3d.town.mesh import Material, Mesh, ball, box, cylinder, loft

Colour = Float[np.ndarray, "3"]


def _torso(hip: tuple[float, float, float], neck: tuple[float, float, float], colour: Colour) -> Mesh:
    """Hips to shoulders: an octagonal skin, wider at the shoulders than deep."""
    angle = 2 * np.pi * np.arange(8) / 8
    rings = []
    for t, wide, deep in ((0.0, 0.17, 0.12), (0.35, 0.16, 0.11), (0.8, 0.215, 0.125), (1.0, 0.10, 0.08)):
        centre = (1 - t) * np.array(hip) + t * np.array(neck)
        rings.append(np.column_stack([deep * np.cos(angle), wide * np.sin(angle), np.zeros(8)]) + centre)
    return loft(rings, colour)


def _head(position: tuple[float, float, float], skin: Colour, hair: Colour) -> list[Mesh]:
    x, y, z = position
    return [ball((x + 0.01, y, z), (0.10, 0.082, 0.125), skin), ball((x - 0.018, y, z + 0.035), (0.10, 0.088, 0.11), hair)]


def pedestrian(
    size_m: Float[np.ndarray, "3"], stride: float, top: Colour, trousers: Colour, skin: Colour, hair: Colour
) -> Mesh:
    """A person in mid-step; ``stride`` in [-1, 1] is the swing of the left leg (0 stands).

    The body keeps within ``size_m``, the box of the widest step, and is scaled by height.
    """
    swing = 0.26 * stride
    parts: list[Mesh] = []
    for side, forward in ((1, swing), (-1, -swing)):
        hip, knee = (0.0, side * 0.09, 0.90), (forward * 0.62 + 0.05 * abs(stride), side * 0.095, 0.48)
        foot = (forward * 1.15, side * 0.10, 0.09)
        parts += [cylinder(hip, knee, 0.085, trousers, 6, 0.065), cylinder(knee, foot, 0.065, trousers, 6, 0.05)]
        parts.append(box((foot[0] + 0.05, foot[1], 0.045), (0.25, 0.095, 0.09), TRIM))
        shoulder, elbow = (0.0, side * 0.21, 1.40), (-forward * 0.5, side * 0.255, 1.12)
        hand = (-forward * 0.95 + 0.05, side * 0.245, 0.88)
        parts += [cylinder(shoulder, elbow, 0.055, top, 6, 0.045), cylinder(elbow, hand, 0.045, top, 5, 0.035)]
        parts.append(ball(hand, 0.05, skin, rings=2, sides=5))
    parts.append(_torso((0.0, 0.0, 0.86), (0.01, 0.0, 1.50), top))
    parts.append(cylinder((0.0, 0.0, 1.45), (0.01, 0.0, 1.56), 0.055, skin, 6))
    parts += _head((0.015, 0.0, 1.63), skin, hair)
    figure = Mesh.merge(parts)
    scale = np.array([size_m[2] / 1.775] * 3, dtype=np.float32)
    fit = np.minimum(1.0, np.asarray(size_m, dtype=np.float32)[:2] / (2 * np.abs(figure.vertices[:, :2] * scale[:2]).max(0)))
    figure.vertices[:] *= scale * np.append(fit, 1).astype(np.float32)
    return figure


def _spoked_wheel(x: float, radius: float, tyre: float) -> list[Mesh]:
    """A ring in the x-z plane made of short rods, with a hub."""
    angle = 2 * np.pi * np.arange(13) / 12
    rim = np.column_stack([x + (radius - tyre) * np.cos(angle), np.zeros(13), radius + (radius - tyre) * np.sin(angle)])
    rods = [cylinder(rim[i], rim[i + 1], tyre, RUBBER, 4) for i in range(12)]
    spokes = [cylinder(rim[i], rim[i + 6], 0.008, TRIM * 3, 3) for i in (0, 2, 4)]
    return rods + spokes


def bicycle(frame: Colour) -> list[Mesh]:
    """A bicycle, 1.75 m long, without rider."""
    crank, seat, head = (-0.05, 0.0, 0.30), (-0.22, 0.0, 0.88), (0.40, 0.0, 0.86)
    parts = _spoked_wheel(-0.52, 0.345, 0.022) + _spoked_wheel(0.53, 0.345, 0.022)
    for start, end in ((crank, seat), (crank, head), (seat, head), ((-0.52, 0.0, 0.345), crank), ((-0.52, 0.0, 0.345), seat)):
        parts.append(cylinder(start, end, 0.024, frame, 5))
    parts += [cylinder((0.36, 0.0, 1.02), (0.53, 0.0, 0.345), 0.022, frame, 5)]
    parts += [
        cylinder((0.38, -0.28, 1.04), (0.38, 0.28, 1.04), 0.018, TRIM, 4),
        box((-0.25, 0.0, 0.93), (0.24, 0.14, 0.06), TRIM),
    ]
    parts += [
        box((0.47, 0.0, 0.92), (0.06, 0.08, 0.08), HEADLIGHT, Material.LAMP),
        box((-0.42, 0.0, 0.80), (0.05, 0.08, 0.08), TAILLIGHT, Material.LAMP),
    ]
    return parts


def _rider(
    seat: tuple[float, float, float],
    grip: tuple[float, float, float],
    pedal: tuple[float, float, float],
    top: Colour,
    trousers: Colour,
    skin: Colour,
    helmet: Colour,
) -> list[Mesh]:
    """Someone leaning from the seat to the handlebar."""
    lean = 0.42 * (grip[0] - seat[0])
    neck = (seat[0] + lean, 0.0, seat[2] + 0.56)
    parts = [_torso((seat[0], 0.0, seat[2] + 0.02), neck, top)]
    for side, up in ((1, 0.08), (-1, -0.08)):
        knee = (0.5 * (seat[0] + pedal[0]) + 0.25, side * 0.14, 0.5 * (seat[2] + pedal[2]) + 0.08 + up)
        foot = (pedal[0], side * 0.12, pedal[2] + up)
        parts += [cylinder((seat[0], side * 0.1, seat[2] + 0.05), knee, 0.085, trousers, 6, 0.07)]
        parts += [
            cylinder(knee, foot, 0.065, trousers, 6, 0.05),
            box((foot[0] + 0.05, foot[1], foot[2] - 0.03), (0.25, 0.09, 0.08), TRIM),
        ]
        elbow = (0.5 * (neck[0] + grip[0]), side * 0.27, 0.5 * (neck[2] + grip[2]) - 0.12)
        parts += [
            cylinder((neck[0] - 0.02, side * 0.2, neck[2] - 0.09), elbow, 0.055, top, 6),
            cylinder(elbow, (grip[0], side * 0.24, grip[2]), 0.045, top, 5),
        ]
    head = (neck[0] + 0.07, 0.0, neck[2] + 0.14)
    return [
        *parts,
        ball(head, (0.10, 0.085, 0.125), skin),
        ball((head[0] - 0.015, 0.0, head[2] + 0.045), (0.13, 0.105, 0.11), helmet),
    ]


def cyclist(size_m: Float[np.ndarray, "3"], frame: Colour, top: Colour, trousers: Colour, skin: Colour, helmet: Colour) -> Mesh:
    """A bicycle with its rider."""
    parts = bicycle(frame) + _rider((-0.22, 0.0, 0.93), (0.38, 0.0, 1.05), (-0.05, 0.0, 0.30), top, trousers, skin, helmet)
    return Mesh.merge(parts).fitted(size_m)


def parked_bicycle(size_m: Float[np.ndarray, "3"], frame: Colour) -> Mesh:
    return Mesh.merge(bicycle(frame)).fitted(size_m)


def motorcycle(size_m: Float[np.ndarray, "3"], paint: Colour, rider: tuple[Colour, Colour, Colour, Colour] | None) -> Mesh:
    """A motorcycle; ``rider`` gives the colours of top, trousers, skin and helmet, or nobody sits on it."""
    parts: list[Mesh] = []
    for x in (-0.66, 0.70):
        parts += [
            cylinder((x, -0.075, 0.31), (x, 0.075, 0.31), 0.31, RUBBER, 14),
            cylinder((x, -0.08, 0.31), (x, 0.08, 0.31), 0.16, TRIM * 6, 8),
        ]
    parts += [
        box((0.0, 0.0, 0.48), (0.75, 0.30, 0.36), TRIM, taper=(0.8, 0.8)),
        ball((0.16, 0.0, 0.82), (0.30, 0.17, 0.17), paint, Material.PAINT),
    ]
    parts += [
        box((-0.36, 0.0, 0.80), (0.72, 0.26, 0.12), TRIM, taper=(0.9, 0.8)),
        box((-0.72, 0.0, 0.78), (0.3, 0.2, 0.16), paint, Material.PAINT, (0.6, 0.7)),
    ]
    parts += [
        cylinder((0.50, 0.0, 1.0), (0.70, 0.0, 0.31), 0.05, TRIM * 4, 6),
        box((0.72, 0.0, 0.64), (0.46, 0.15, 0.06), paint, Material.PAINT),
    ]
    parts += [
        cylinder((0.42, -0.36, 1.05), (0.42, 0.36, 1.05), 0.022, TRIM, 5),
        box((0.62, 0.0, 0.92), (0.12, 0.2, 0.2), HEADLIGHT, Material.LAMP),
    ]
    parts += [
        box((-0.88, 0.0, 0.80), (0.05, 0.16, 0.09), TAILLIGHT, Material.LAMP),
        cylinder((-0.75, -0.16, 0.34), (0.1, -0.16, 0.32), 0.06, TRIM * 7, 6),
    ]
    if rider is not None:
        parts += _rider((-0.30, 0.0, 0.84), (0.42, 0.0, 1.06), (0.0, 0.0, 0.36), *rider)
    else:
        parts.append(box((0.52, 0.0, 1.18), (0.08, 0.3, 0.25), TRIM * 2, taper=(0.5, 0.7)))
    return Mesh.merge(parts).fitted(size_m)
