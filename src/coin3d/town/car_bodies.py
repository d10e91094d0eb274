"""Bodies of cars, vans and pick-ups: a skin over cross-sections, so that bonnet, windscreen, cabin and boot are real shape.

Body frame: x forward, y left, z up, origin below the middle of the body on the ground.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from coin3d.town.car_shapes import CarShape
from coin3d.town.mesh import Material, Mesh, cylinder, quad

GLASS = np.array([0.03, 0.035, 0.04])
RUBBER = np.array([0.02, 0.02, 0.022])
TRIM = np.array([0.035, 0.035, 0.04])
HEADLIGHT = np.array([0.95, 0.95, 0.90])
TAILLIGHT = np.array([0.75, 0.03, 0.03])
INDICATOR = np.array([0.85, 0.35, 0.04])
HUB = np.array([0.35, 0.35, 0.37])


def car_body(
    shape: CarShape, size_m: Float[np.ndarray, "3"], paint: Float[np.ndarray, "3"], plate: Float[np.ndarray, "3"]
) -> Mesh:
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
    return float((width_m / 2 - 0.02) * (1.0 - 0.9 * max(0.0, abs(x) - 0.40) ** 1.2))


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


def panel(
    x: float,
    y: tuple[float, float],
    z: tuple[float, float],
    colour: Float[np.ndarray, "3"],
    front: bool,
    material: Material = Material.MATT,
) -> Mesh:
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
