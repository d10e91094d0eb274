"""Bodies of trucks and buses."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from coin3d.town.car_bodies import GLASS, HEADLIGHT, INDICATOR, TAILLIGHT, TRIM, panel, wheel
from coin3d.town.mesh import Material, Mesh, box, loft, quad


def _prism(profile: list[tuple[float, float]], half_width_m: float, colour: Float[np.ndarray, "3"], material: Material) -> Mesh:
    """A side view (x, z), counter-clockwise seen from the right (-y), pushed out to both sides."""
    points = np.array(profile)
    right = np.column_stack([points[:, 0], np.full(len(points), -half_width_m), points[:, 1]])
    left = right * [1, -1, 1]
    return loft([left, right], colour, material)


def truck_body(size_m: Float[np.ndarray, "3"], paint: Float[np.ndarray, "3"], cargo: Float[np.ndarray, "3"]) -> Mesh:
    """A cab with a sloping windscreen in front of a tall box, on a dark chassis."""
    length, width, height = size_m
    front, rear, half = length / 2, -length / 2, width / 2 - 0.03
    cab_rear = front - 1.9
    cab_height = min(0.86 * height, 2.55)
    cab = _prism(
        [
            (cab_rear, 0.55),
            (front, 0.42),
            (front, 1.25),
            (front - 0.12, 1.4),
            (front - 0.45, cab_height - 0.08),
            (front - 0.7, cab_height),
            (cab_rear, cab_height),
        ],
        half - 0.02,
        paint,
        Material.PAINT,
    )
    screen = [
        (front - 0.125, -half * 0.9, 1.45),
        (front - 0.125, half * 0.9, 1.45),
        (front - 0.425, half * 0.86, cab_height - 0.15),
        (front - 0.425, -half * 0.86, cab_height - 0.15),
    ]
    parts = [
        cab,
        quad(np.add(screen, [0.02, 0, 0.005]), GLASS, Material.GLASS),
        box(
            ((rear + cab_rear - 0.25) / 2, 0, (0.95 + height) / 2),
            (cab_rear - 0.25 - rear - 0.03, width - 0.04, height - 0.95),
            cargo,
            Material.PAINT,
        ),
        box((-0.3, 0, 0.72), (length - 0.9, width * 0.5, 0.42), TRIM),
        panel(front + 0.01, (-half * 0.55, half * 0.55), (0.8, 1.2), TRIM, True),
        panel(front + 0.012, (-0.26, 0.26), (0.5, 0.61), np.array([0.8, 0.8, 0.78]), True),
        panel(rear - 0.002, (-half * 0.96, half * 0.96), (0.52, 0.78), TRIM, False),
        panel(rear - 0.004, (-0.02, 0.02), (1.0, height - 0.1), TRIM, False),
        panel(rear - 0.008, (-0.26, 0.26), (0.6, 0.71), np.array([0.8, 0.8, 0.78]), False),
    ]
    for side in (-1.0, 1.0):
        window = [
            (front - 0.55, 1.45),
            (front - 0.62, cab_height - 0.3),
            (cab_rear + 0.45, cab_height - 0.3),
            (cab_rear + 0.45, 1.45),
        ]
        corners = np.array([(x, side * (half - 0.012), z) for x, z in window])
        parts.append(quad(corners if side > 0 else corners[::-1], GLASS, Material.GLASS))
        y = sorted((side * half * 0.62, side * half * 0.93))
        parts.append(panel(front + 0.014, (y[0], y[1]), (0.62, 0.82), HEADLIGHT, True, Material.LAMP))
        y = sorted((side * half * 0.7, side * half * 0.95))
        parts.append(panel(rear - 0.01, (y[0], y[1]), (0.56, 0.72), TAILLIGHT, False, Material.LAMP))
        parts.append(box((front - 0.1, side * (width / 2 - 0.06), 1.85), (0.12, 0.12, 0.45), TRIM))
        for x in (front - 1.1, rear + 1.6):
            parts.append(wheel(x, side * width / 2, 0.48, 0.3))
        if length > 8:
            parts.append(wheel(rear + 2.75, side * width / 2, 0.48, 0.3))
    return Mesh.merge(parts).fitted(size_m)


def bus_body(size_m: Float[np.ndarray, "3"], paint: Float[np.ndarray, "3"], stripe: Float[np.ndarray, "3"]) -> Mesh:
    """A city bus: raked windscreen and destination sign in front, flat tail with engine grille, window band and doors."""
    length, width, height = size_m
    front, rear, half = length / 2, -length / 2, width / 2 - 0.025
    hull = _prism(
        [
            (rear, 0.4),
            (front - 0.1, 0.32),
            (front, 0.7),
            (front, 1.1),
            (front - 0.28, height - 0.35),
            (front - 0.5, height),
            (rear + 0.15, height),
            (rear, height - 0.25),
        ],
        half,
        paint,
        Material.PAINT,
    )
    parts = [
        hull,
        quad(
            np.add(
                [
                    (front + 0.005, -half * 0.95, 1.12),
                    (front + 0.005, half * 0.95, 1.12),
                    (front - 0.225, half * 0.95, height - 0.62),
                    (front - 0.225, -half * 0.95, height - 0.62),
                ],
                [0.012, 0, 0],
            ),
            GLASS,
            Material.GLASS,
        ),
        quad(
            np.add(
                [
                    (front - 0.235, -half * 0.7, height - 0.58),
                    (front - 0.235, half * 0.7, height - 0.58),
                    (front - 0.28, half * 0.7, height - 0.36),
                    (front - 0.28, -half * 0.7, height - 0.36),
                ],
                [0.02, 0, 0],
            ),
            INDICATOR,
            Material.LAMP,
        ),
        panel(front + 0.01, (-half * 0.9, half * 0.9), (0.72, 0.86), TRIM, True),
        panel(rear - 0.008, (-half * 0.7, half * 0.7), (0.75, 1.25), TRIM, False),
        panel(rear - 0.008, (-half * 0.75, half * 0.75), (1.75, height - 0.6), GLASS, False, Material.GLASS),
        panel(rear - 0.01, (-0.26, 0.26), (0.5, 0.62), np.array([0.8, 0.8, 0.78]), False),
    ]
    for side in (-1.0, 1.0):
        y = side * (half + 0.008)
        for start in np.arange(rear + 0.5, front - 1.7, 1.45):
            parts.append(_side_panel(start, start + 1.33, y, 1.35, height - 0.6, GLASS, Material.GLASS))
        parts.append(_side_panel(rear + 0.2, front - 0.4, y, 0.95, 1.15, stripe, Material.PAINT))
        if side < 0:
            for start in (front - 1.5, front - 0.2 * length - 2.6):
                parts.append(_side_panel(start, start + 1.1, y * 1.003, 0.42, height - 0.6, GLASS * 1.5, Material.GLASS))
        lamp = sorted((side * half * 0.6, side * half * 0.92))
        parts.append(panel(front + 0.014, (lamp[0], lamp[1]), (0.72, 0.92), HEADLIGHT, True, Material.LAMP))
        lamp = sorted((side * half * 0.8, side * half * 0.96))
        parts.append(panel(rear - 0.012, (lamp[0], lamp[1]), (0.7, 1.35), TAILLIGHT, False, Material.LAMP))
        for x in (rear + 0.28 * length, front - 0.22 * length):
            parts.append(wheel(x, side * width / 2, 0.48, 0.3))
    return Mesh.merge(parts).fitted(size_m)


def _side_panel(
    x0: float, x1: float, y: float, z0: float, z1: float, colour: Float[np.ndarray, "3"], material: Material
) -> Mesh:
    corners = [(x1, y, z0), (x0, y, z0), (x0, y, z1), (x1, y, z1)]
    return quad(corners if y > 0 else corners[::-1], colour, material)
