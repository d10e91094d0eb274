"""Bodies of cars, vans and pick-ups: a skin over cross-sections, so that bonnet, windscreen, cabin and boot are real shape.

Body frame: x forward, y left, z up, origin below the middle of the body on the ground.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from coin3d.town.mesh import Material, Mesh, cylinder, quad

GLASS = np.array([0.03, 0.035, 0.04])
RUBBER = np.array([0.02, 0.02, 0.022])
TRIM = np.array([0.035, 0.035, 0.04])
HEADLIGHT = np.array([0.95, 0.95, 0.90])
TAILLIGHT = np.array([0.75, 0.03, 0.03])
INDICATOR = np.array([0.85, 0.35, 0.04])
HUB = np.array([0.35, 0.35, 0.37])


@dataclass(frozen=True)
class CarShape:
    """The side view of a body, in fractions of length and height.

    Args:
        sections: from rear to front: (x, belt height, top height, half width at the top, what lies between this section
            and the next). Letters: B body, R rear window, W side window, P pillar, S windscreen, L load bed.
        length_m, width_m, height_m: ranges of the size.
        floor: height of the sill.
        wheel_m: radius of the wheels.
        axles: x of the rear and front axle.
        tail_lamp: lower and upper edge of the rear lamps.
        head_lamp: lower and upper edge of the headlights.
    """

    sections: tuple[tuple[float, float, float, float, str], ...]
    length_m: tuple[float, float]
    width_m: tuple[float, float]
    height_m: tuple[float, float]
    floor: float
    wheel_m: float
    axles: tuple[float, float]
    tail_lamp: tuple[float, float]
    head_lamp: tuple[float, float]


HATCHBACK = CarShape(
    (
        (-0.50, 0.47, 0.54, 0.42, "B"), (-0.480, 0.59, 0.645, 0.42, "R"), (-0.385, 0.61, 0.95, 0.345, "P"),
        (-0.34, 0.61, 0.98, 0.35, "W"), (-0.13, 0.61, 1.00, 0.36, "P"), (-0.10, 0.61, 1.00, 0.36, "W"),
        (0.08, 0.60, 0.975, 0.35, "S"), (0.265, 0.585, 0.64, 0.41, "B"), (0.44, 0.50, 0.57, 0.39, "B"),
        (0.50, 0.41, 0.47, 0.35, "B"),
    ),
    (3.75, 4.3), (1.68, 1.80), (1.44, 1.56), 0.14, 0.31, (-0.31, 0.31), (0.47, 0.62), (0.41, 0.49),
)
SEDAN = CarShape(
    (
        (-0.50, 0.54, 0.63, 0.40, "B"), (-0.487, 0.635, 0.735, 0.41, "B"), (-0.37, 0.645, 0.75, 0.40, "R"),
        (-0.225, 0.645, 0.955, 0.335, "P"), (-0.19, 0.64, 0.98, 0.34, "W"), (-0.05, 0.635, 1.00, 0.35, "P"),
        (-0.03, 0.635, 1.00, 0.35, "W"), (0.05, 0.63, 0.975, 0.34, "S"), (0.22, 0.60, 0.655, 0.41, "B"),
        (0.44, 0.48, 0.55, 0.39, "B"), (0.50, 0.40, 0.455, 0.35, "B"),
    ),
    (4.45, 4.95), (1.77, 1.90), (1.41, 1.50), 0.13, 0.325, (-0.29, 0.31), (0.53, 0.67), (0.395, 0.475),
)
ESTATE = CarShape(
    (
        (-0.50, 0.48, 0.54, 0.42, "B"), (-0.485, 0.60, 0.65, 0.42, "R"), (-0.43, 0.62, 0.94, 0.34, "P"),
        (-0.39, 0.62, 0.96, 0.345, "W"), (-0.20, 0.62, 0.99, 0.35, "P"), (-0.18, 0.62, 0.99, 0.35, "W"),
        (-0.01, 0.62, 1.0, 0.35, "P"), (0.01, 0.62, 1.0, 0.35, "W"), (0.09, 0.61, 0.975, 0.345, "S"),
        (0.26, 0.60, 0.655, 0.41, "B"), (0.45, 0.50, 0.57, 0.39, "B"), (0.50, 0.42, 0.48, 0.35, "B"),
    ),
    (4.5, 4.95), (1.78, 1.88), (1.44, 1.53), 0.13, 0.325, (-0.29, 0.31), (0.50, 0.66), (0.42, 0.50),
)
SUV = CarShape(
    (
        (-0.50, 0.50, 0.57, 0.43, "B"), (-0.49, 0.61, 0.66, 0.43, "R"), (-0.435, 0.62, 0.94, 0.36, "P"),
        (-0.39, 0.62, 0.97, 0.37, "W"), (-0.20, 0.62, 0.99, 0.375, "P"), (-0.17, 0.62, 1.00, 0.375, "W"),
        (0.06, 0.615, 0.98, 0.37, "S"), (0.215, 0.61, 0.66, 0.43, "B"), (0.45, 0.565, 0.615, 0.42, "B"),
        (0.50, 0.47, 0.53, 0.38, "B"),
    ),
    (4.35, 4.9), (1.84, 1.98), (1.64, 1.80), 0.16, 0.37, (-0.29, 0.31), (0.48, 0.66), (0.46, 0.54),
)
PANEL_VAN = CarShape(
    (
        (-0.50, 0.48, 0.95, 0.40, "B"), (-0.49, 0.50, 0.985, 0.405, "B"), (-0.10, 0.50, 1.0, 0.41, "B"),
        (0.08, 0.49, 1.0, 0.41, "W"), (0.21, 0.48, 0.975, 0.39, "S"), (0.365, 0.46, 0.52, 0.42, "B"),
        (0.475, 0.40, 0.455, 0.40, "B"), (0.50, 0.33, 0.385, 0.38, "B"),
    ),
    (4.9, 5.9), (1.95, 2.08), (2.05, 2.55), 0.12, 0.35, (-0.30, 0.33), (0.33, 0.50), (0.325, 0.395),
)
MINIVAN = CarShape(
    (
        (-0.50, 0.47, 0.52, 0.43, "B"), (-0.49, 0.56, 0.60, 0.43, "R"), (-0.45, 0.57, 0.95, 0.38, "P"),
        (-0.42, 0.57, 0.98, 0.385, "W"), (-0.21, 0.57, 1.0, 0.39, "P"), (-0.18, 0.57, 1.0, 0.39, "W"),
        (0.03, 0.56, 1.0, 0.39, "P"), (0.06, 0.56, 0.995, 0.39, "W"), (0.13, 0.55, 0.97, 0.38, "S"),
        (0.32, 0.53, 0.58, 0.42, "B"), (0.465, 0.46, 0.51, 0.40, "B"), (0.50, 0.38, 0.43, 0.37, "B"),
    ),
    (4.5, 5.1), (1.82, 1.98), (1.75, 1.98), 0.13, 0.34, (-0.30, 0.32), (0.45, 0.72), (0.38, 0.46),
)
PICKUP = CarShape(
    (
        (-0.50, 0.50, 0.555, 0.44, "B"), (-0.495, 0.52, 0.575, 0.44, "L"), (-0.125, 0.52, 0.575, 0.44, "B"),
        (-0.12, 0.60, 0.93, 0.36, "P"), (-0.10, 0.61, 0.97, 0.37, "W"), (0.02, 0.61, 1.0, 0.375, "P"),
        (0.035, 0.61, 1.0, 0.375, "W"), (0.115, 0.60, 0.975, 0.37, "S"), (0.235, 0.59, 0.635, 0.43, "B"),
        (0.46, 0.55, 0.60, 0.42, "B"), (0.50, 0.46, 0.52, 0.39, "B"),
    ),
    (5.15, 5.6), (1.88, 2.02), (1.74, 1.86), 0.19, 0.38, (-0.30, 0.33), (0.40, 0.53), (0.45, 0.53),
)


def car_body(shape: CarShape, size_m: Float[np.ndarray, "3"], paint: Float[np.ndarray, "3"], plate: Float[np.ndarray, "3"]) -> Mesh:
    """The body with wheels, lamps, plates and grille, exactly ``size_m`` (length, width, height)."""
    length, width, height = size_m
    parts = [_skin(shape, length, width, height, paint)]
    parts += _front_details(shape, length, width, height, paint)
    parts += _rear_details(shape, length, width, height, plate)
    for x in shape.axles:
        for side in (-1, 1):
            parts.append(wheel(x * length, side * width / 2, shape.wheel_m))
    for side in (-1, 1):
        cowl = next(x for x, *_, kind in reversed(shape.sections) if kind == "S") * length
        y, z = side * (width / 2 - 0.005), (shape.sections[-4][1] + 0.05) * height
        parts.append(cylinder((cowl + 0.45, side * width * 0.44, z), (cowl + 0.42, y, z + 0.03), 0.07, TRIM, sides=5))
    return Mesh.merge(parts).fitted(size_m)


def wheel(x_m: float, y_outer_m: float, radius_m: float, width_m: float = 0.22) -> Mesh:
    """A wheel touching the ground whose outer face lies at ``y_outer_m``, in a dark wheel house."""
    inward = -np.sign(y_outer_m)
    tyre = cylinder((x_m, y_outer_m, radius_m), (x_m, y_outer_m + inward * width_m, radius_m), radius_m, RUBBER, sides=14)
    house = (x_m, y_outer_m + inward * 0.012, radius_m), (x_m, y_outer_m + inward * 0.1, radius_m)
    arch = cylinder(*house, radius_m * 1.17, TRIM * 0.5, sides=14)
    rim = (x_m, y_outer_m - inward * 0.004, radius_m), (x_m, y_outer_m + inward * 0.05, radius_m)
    return Mesh.merge([tyre, arch, cylinder(*rim, radius_m * 0.6, HUB, sides=8)])


def _half_width(x: float, width_m: float) -> float:
    """Half the width at a fraction of the length: the plan view narrows towards both ends."""
    return (width_m / 2 - 0.02) * (1.0 - 0.9 * max(0.0, abs(x) - 0.40) ** 1.2)


def _skin(shape: CarShape, length: float, width: float, height: float, paint: Float[np.ndarray, "3"]) -> Mesh:
    rings = []
    for x, belt, top, top_half, _ in shape.sections:
        half = _half_width(x, width)
        pinch = half / _half_width(0.0, width)
        zs = np.array([shape.floor, min(0.36, belt - 0.05), belt, belt + 0.80 * (top - belt), top]) * height
        ys = np.array([0.92 * half, half, 0.965 * half, 0, top_half * width * pinch])
        ys[3] = ys[4] + 0.25 * (ys[2] - ys[4]) + 0.012
        ring = np.concatenate([np.column_stack([ys, zs]), np.column_stack([-ys[::-1], zs[::-1]])])
        rings.append(np.column_stack([np.full(10, x * length), ring]))
    stack, n = np.asarray(rings), 10
    faces, colours, materials = [], [], []
    for i in range(len(rings) - 1):
        kind = shape.sections[i][4]
        for j in range(n):
            a, b = i * n + j, i * n + (j + 1) % n
            # triangles split along the pillar, not across it
            faces += [[a, b, b + n], [a, b + n, a + n]]
            glass = (j == 4 and kind in "RS") or (j in (2, 6) and kind in "WRS")
            bare = (j == 4 and kind == "L") or j == 9
            colours += [GLASS if glass else TRIM if bare else paint] * 2
            materials += [Material.GLASS if glass else Material.MATT if bare else Material.PAINT] * 2
    last = (len(rings) - 1) * n
    for j in range(1, n - 1):
        faces += [[0, j + 1, j], [last, last + j, last + j + 1]]
        colours += [paint] * 2
        materials += [Material.PAINT] * 2
    return Mesh(
        stack.reshape(-1, 3).astype(np.float32),
        np.array(faces, dtype=np.int32),
        np.array(colours, dtype=np.float32),
        np.array(materials, dtype=np.uint8),
        np.full(len(faces), -1, dtype=np.int32),
    )


def panel(x: float, y: tuple[float, float], z: tuple[float, float], colour: Float[np.ndarray, "3"], front: bool,
          material: Material = Material.MATT) -> Mesh:
    """An upright rectangle across the vehicle, facing forward or backward."""
    corners = [(x, y[0], z[0]), (x, y[1], z[0]), (x, y[1], z[1]), (x, y[0], z[1])]
    return quad(corners if front else corners[::-1], colour, material)


def _front_details(shape: CarShape, length: float, width: float, height: float, paint: Float[np.ndarray, "3"]) -> list[Mesh]:
    x, (low, high) = length / 2 + 0.006, np.array(shape.head_lamp) * height
    parts = [panel(x, (-0.24 * width, 0.24 * width), (low - 0.02, high - 0.01), TRIM, True)]
    parts.append(panel(x, (-0.36 * width, 0.36 * width), (shape.floor * height, shape.floor * height + 0.16), TRIM, True))
    parts.append(panel(x + 0.008, (-0.26, 0.26), (low - 0.17, low - 0.06), np.array([0.8, 0.8, 0.78]), True))
    for side in (-1.0, 1.0):
        y = sorted((side * 0.26 * width, side * 0.40 * width))
        parts.append(panel(x + 0.004, (y[0], y[1]), (low, high), HEADLIGHT, True, Material.LAMP))
        edge, back = side * 0.40 * width, 0.24
        outer = side * (_half_width(0.5 - back / length, width) + 0.016)
        corner = [(x, edge, low), (x - back, outer, low + 0.02), (x - back - 0.05, outer * 0.99, high + 0.02), (x, edge, high)]
        parts.append(quad(corner if side > 0 else corner[::-1], HEADLIGHT, Material.LAMP))
    return parts


def _rear_details(shape: CarShape, length: float, width: float, height: float, plate: Float[np.ndarray, "3"]) -> list[Mesh]:
    x, (low, high) = -length / 2 - 0.006, np.array(shape.tail_lamp) * height
    parts = [panel(x, (-0.36 * width, 0.36 * width), (shape.floor * height, shape.floor * height + 0.18), TRIM, False)]
    parts.append(panel(x - 0.008, (-0.26, 0.26), (low - 0.13, low - 0.02), plate, False))
    for side in (-1.0, 1.0):
        edge, ahead = side * 0.44 * width, 0.16
        y = sorted((side * 0.30 * width, edge))
        parts.append(panel(x - 0.004, (y[0], y[1]), (low, high), TAILLIGHT, False, Material.LAMP))
        outer = side * (_half_width(0.5 - ahead / length, width) + 0.016)
        corner = [(x, edge, low), (x + ahead, outer, low + 0.01), (x + ahead, outer * 0.985, high - 0.01), (x, edge, high)]
        parts.append(quad(corner[::-1] if side > 0 else corner, TAILLIGHT, Material.LAMP))
    return parts
