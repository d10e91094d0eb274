"""Class maps: what becomes a car, a pedestrian, a two-wheeler; what is dropped; what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from coin3d.datasets.classes import MERGED_CAR, PLAIN_CAR, THREE_CLASS, ClassMap
from coin3d.geometry import Boxes3D


def _boxes(*labels: str) -> Boxes3D:
    n = len(labels)
    return Boxes3D.create(np.arange(3 * n).reshape(n, 3), np.ones((n, 3)), np.zeros(n), labels)


NUSCENES = _boxes(
    "vehicle.car", "vehicle.truck", "vehicle.bus.bendy", "vehicle.trailer", "vehicle.construction",
    "vehicle.emergency.police", "human.pedestrian.child", "human.pedestrian.stroller", "vehicle.bicycle",
    "vehicle.motorcycle", "movable_object.barrier",
)  # fmt: skip
LYFT = _boxes("car", "truck", "emergency_vehicle", "other_vehicle", "pedestrian", "bicycle", "animal")
DETECTION = _boxes(
    "car", "truck", "construction_vehicle", "bus", "trailer", "barrier", "motorcycle", "bicycle", "pedestrian", "traffic_cone"
)  # fmt: skip
WAYMO = _boxes("VEHICLE", "PEDESTRIAN", "SIGN", "CYCLIST", "UNKNOWN")


@pytest.mark.parametrize(
    ("boxes", "cars", "merged", "pedestrians", "two_wheelers"),
    [(NUSCENES, 1, 5, 1, 2), (DETECTION, 1, 5, 1, 2), (LYFT, 1, 4, 1, 1), (WAYMO, 1, 1, 1, 1)],
)
def test_counts(boxes: Boxes3D, cars: int, merged: int, pedestrians: int, two_wheelers: int) -> None:
    assert PLAIN_CAR.apply(boxes).labels.tolist() == ["car"] * cars
    assert MERGED_CAR.apply(boxes).labels.tolist() == ["car"] * merged
    labels = THREE_CLASS.apply(boxes).labels.tolist()
    assert [labels.count(c) for c in ("car", "pedestrian", "two-wheel")] == [merged, pedestrians, two_wheelers]


def test_rows_stay_together() -> None:
    mapped = THREE_CLASS.apply(LYFT)
    np.testing.assert_array_equal(mapped.centre_m[-1], LYFT.centre_m[5])
    assert mapped.labels[-1] == "two-wheel"


def test_mapping_twice_changes_nothing() -> None:
    once = THREE_CLASS.apply(NUSCENES)
    assert THREE_CLASS.apply(once).labels.tolist() == once.labels.tolist()


def test_nothing_to_map() -> None:
    assert len(THREE_CLASS.apply(Boxes3D.empty())) == 0
    assert len(PLAIN_CAR.apply(_boxes("SIGN"))) == 0


def test_unknown_names_are_refused() -> None:
    with pytest.raises(ValueError, match="does not know the categories spaceship"):
        THREE_CLASS.apply(_boxes("car", "spaceship"))
    with pytest.raises(ValueError, match="unknown categories: spaceship"):
        ClassMap("mine", {"spaceship": "car"})


def test_classes_in_order() -> None:
    assert THREE_CLASS.classes == ("car", "pedestrian", "two-wheel")
    assert PLAIN_CAR.classes == MERGED_CAR.classes == ("car",)
