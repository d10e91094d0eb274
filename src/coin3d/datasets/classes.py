"""Class maps: a data set's own category names to the classes a detector is trained and scored on.

One map knows the names of nuScenes, Lyft, Waymo and DDAD together, because their names do not collide in meaning; those of
nuScenes' ten detection classes as well, which released detectors find. Names that
are left out on purpose are listed, so that a name nobody has thought of is an error and never silently dropped.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from coin3d.geometry import Boxes3D

CAR = "car"
PEDESTRIAN = "pedestrian"
TWO_WHEEL = "two-wheel"

_PLAIN_CARS = ("vehicle.car", "car", "VEHICLE", "Car")
# what the merged "car" adds: nuScenes truck, bus, trailer, construction vehicle; Lyft truck, bus, emergency, other; nuScenes'
# detection classes; DDAD's
_OTHER_CARS = (
    "vehicle.truck", "vehicle.bus.bendy", "vehicle.bus.rigid", "vehicle.trailer", "vehicle.construction",
    "truck", "bus", "emergency_vehicle", "other_vehicle",
    "construction_vehicle", "trailer",
    "Truck", "Bus/RV/Caravan", "Trailer", "Towed Object",
)  # fmt: skip
_PEDESTRIANS = (
    "human.pedestrian.adult", "human.pedestrian.child", "human.pedestrian.construction_worker",
    "human.pedestrian.police_officer", "pedestrian", "PEDESTRIAN", "Person",
)  # fmt: skip
_TWO_WHEELERS = (
    "vehicle.bicycle", "vehicle.motorcycle", "bicycle", "motorcycle", "two-wheel", "CYCLIST", "Bicycle", "Motorcycle",
)  # fmt: skip
_NEVER = (
    "vehicle.emergency.ambulance", "vehicle.emergency.police", "human.pedestrian.personal_mobility",
    "human.pedestrian.stroller", "human.pedestrian.wheelchair", "animal", "movable_object.barrier",
    "movable_object.debris", "movable_object.pushable_pullable", "movable_object.trafficcone",
    "static_object.bicycle_rack", "barrier", "traffic_cone", "SIGN", "UNKNOWN", "Train", "Wheeled Slow",
)  # fmt: skip
KNOWN_CATEGORIES = frozenset((*_PLAIN_CARS, *_OTHER_CARS, *_PEDESTRIANS, *_TWO_WHEELERS, *_NEVER))
"""Every category name of nuScenes, Lyft, Waymo and DDAD, nuScenes' detection classes, and the unified names themselves."""


@dataclass(frozen=True)
class ClassMap:
    """From category names to class names.

    Args:
        name: for protocols and reports.
        mapping: category name -> class name; known names that are not in it are dropped.
    """

    name: str
    mapping: Mapping[str, str]

    def __post_init__(self) -> None:
        unknown = sorted(set(self.mapping) - KNOWN_CATEGORIES)
        if unknown or not self.mapping:
            raise ValueError(f"class map '{self.name}' maps nothing or unknown categories: {', '.join(unknown) or '(empty)'}")
        object.__setattr__(self, "mapping", MappingProxyType(dict(self.mapping)))

    @property
    def classes(self) -> tuple[str, ...]:
        """The class names, in order of first appearance."""
        return tuple(dict.fromkeys(self.mapping.values()))

    def apply(self, boxes: Boxes3D) -> Boxes3D:
        """The boxes that have a class, labelled with it; the rest is dropped.

        Raises:
            ValueError: a category that is neither mapped nor known to be ignored.
        """
        unknown = sorted(set(map(str, boxes.labels)) - KNOWN_CATEGORIES)
        if unknown:
            raise ValueError(
                f"class map '{self.name}' does not know the categories {', '.join(unknown)}; "
                "give the annotations the category names of nuScenes, Lyft, Waymo or DDAD (docs/datasets.md)"
            )
        kept = boxes[np.array([str(label) in self.mapping for label in boxes.labels], dtype=bool)]
        return kept.with_labels([self.mapping[str(label)] for label in kept.labels])


def _to(class_name: str, *categories: str) -> dict[str, str]:
    return dict.fromkeys(categories, class_name)


PLAIN_CAR = ClassMap("plain car", _to(CAR, *_PLAIN_CARS))
"""Cars in the narrow sense; Waymo only has VEHICLE."""

MERGED_CAR = ClassMap("merged car", _to(CAR, *_PLAIN_CARS, *_OTHER_CARS))
"""Everything that Waymo would call VEHICLE is a car (docs/datasets.md)."""

THREE_CLASS = ClassMap(
    "car, pedestrian, two-wheel",
    {**MERGED_CAR.mapping, **_to(PEDESTRIAN, *_PEDESTRIANS), **_to(TWO_WHEEL, *_TWO_WHEELERS)},
)
"""The three unified classes, with the merged car."""
