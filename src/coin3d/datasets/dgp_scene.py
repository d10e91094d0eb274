"""One scene of a DGP recording: its samples in time order, each a set of data with a pose of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from coin3d.datasets.dgp_files import (
    Calibration,
    field,
    name_of,
    read_calibration,
    read_json,
    read_pose,
    read_time_ns,
    rows_of,
)
from coin3d.datasets.inside import inside, plain_name
from coin3d.datasets.json_values import shown, whole
from coin3d.geometry import Pose

_BOXES_3D = "1"
"""DGP's number of the annotation type "bounding box 3D"."""


@dataclass(frozen=True, eq=False)
class Datum:
    """An image or a point cloud as the scene file lists it.

    Args:
        key: unique in the scene.
        name: of the sensor.
        kind: ``image`` or ``point_cloud``.
        time_ns: of this datum.
        content: the fields of its kind.
        folder: of the scene, which file names are relative to.
        where: for messages.
    """

    key: str
    name: str
    kind: str
    time_ns: int
    content: Mapping[str, Any]
    folder: Path
    where: str

    @property
    def path(self) -> Path:
        """The image or point cloud."""
        return inside(self.folder, field(self.content, "filename", self.where), f"{self.where}: filename")

    @property
    def boxes_path(self) -> Path | None:
        """Its 3D annotations, if there are any; raises ValueError."""
        listed = self.content.get("annotations") or {}
        if not isinstance(listed, Mapping):
            raise ValueError(f"{self.where}: 'annotations' names files by kind, got {shown(listed)}")
        name = listed.get(_BOXES_3D)
        return None if name is None else inside(self.folder, name, f"{self.where}: annotations")

    def world_from_sensor(self) -> Pose:
        """Pose of the sensor at the time of this datum; raises ValueError."""
        return read_pose(field(self.content, "pose", self.where), self.where)


@dataclass(frozen=True, eq=False)
class DgpSample:
    """What the sensors saw around one instant.

    Args:
        data: sensor name -> datum, by name.
        calibration_key: name of the calibration file.
    """

    data: Mapping[str, Datum]
    calibration_key: str

    @property
    def cameras(self) -> list[Datum]:
        """The images."""
        return [d for d in self.data.values() if d.kind == "image"]

    @property
    def lidar(self) -> Datum | None:
        """The point cloud; of several the one called LIDAR, else the first by name."""
        clouds = [d for d in self.data.values() if d.kind == "point_cloud"]
        return next((d for d in clouds if d.name == "LIDAR"), next(iter(clouds), None))

    @property
    def reference(self) -> Datum:
        """Whose time and pose are those of the frame: the LiDAR's, without one the first camera's."""
        return self.lidar or self.cameras[0]


class DgpScene:
    """A parsed scene file.

    Args:
        path: ``scene_<hash>.json`` in the folder of the scene.
        name: unique in the recording.

    Raises:
        ValueError: missing or damaged, a sample that lists an unknown datum, or a sample without images.
    """

    def __init__(self, path: Path, name: str) -> None:
        self.path, self.name, self.folder = path, name, path.parent
        content = read_json(path)
        rows, samples = rows_of(content, "data", str(path)), rows_of(content, "samples", str(path))
        self._ontologies = content.get("ontologies") or {}
        self._calibrations: dict[str, Calibration] = {}
        data: dict[str, Datum | None] = {}
        for row in rows:
            key, datum = self._datum(row)
            if key in data:
                raise ValueError(f"{path}: the datum '{key}' is there twice")
            data[key] = datum
        self.samples = [self._sample(row, n, data) for n, row in enumerate(samples)]
        if not self.samples:
            raise ValueError(f"{path}: the scene has no samples")
        self.samples.sort(key=lambda sample: sample.reference.time_ns)

    def calibration(self, sample: DgpSample) -> Calibration:
        """The calibration of a sample, parsed once; raises ValueError."""
        key = sample.calibration_key
        if key not in self._calibrations:
            self._calibrations[key] = read_calibration(self.folder / "calibration" / f"{key}.json")
        return self._calibrations[key]

    @cached_property
    def categories(self) -> dict[int, str]:
        """Class id -> name of the 3D annotations; raises ValueError if the ontology is missing or damaged."""
        where = f"{self.path}: ontologies"
        key = plain_name(field(self._ontologies, _BOXES_3D, where), where)
        path = self.folder / "ontology" / f"{key}.json"
        found: dict[int, str] = {}
        for item in rows_of(read_json(path), "items", str(path)):
            class_id = whole(field(item, "id", str(path)), f"{path}: id", -(2**31), 2**31)
            if class_id in found:
                raise ValueError(f"{path}: the class id {class_id} is there twice")
            found[class_id] = name_of(item, "name", str(path))
        return found

    def _datum(self, row: Any) -> tuple[str, Datum | None]:
        key = name_of(row, "key", f"{self.path}: a datum")
        where = f"{self.path}: datum '{key}'"
        identity, kinds = field(row, "id", where), field(row, "datum", where)
        if not isinstance(kinds, Mapping):
            raise ValueError(f"{where}: 'datum' holds an image or a point cloud, got {shown(kinds)}")
        kind = next((k for k in ("image", "point_cloud") if k in kinds), None)
        if kind is None:
            return key, None  # radar and other sensors
        if not isinstance(kinds[kind], Mapping):
            raise ValueError(f"{where}: '{kind}' has fields, got {shown(kinds[kind])}")
        time_ns = read_time_ns(field(identity, "timestamp", where), where)
        name = plain_name(field(identity, "name", where), f"{where}: name")
        return key, Datum(key, name, kind, time_ns, kinds[kind], self.folder, where)

    def _sample(self, row: Any, number: int, data: Mapping[str, Datum | None]) -> DgpSample:
        where = f"{self.path}: sample {number}"
        own: dict[str, Datum] = {}
        for key in rows_of(row, "datum_keys", where):
            if not isinstance(key, str) or key not in data:
                raise ValueError(f"{where} lists the datum {shown(key)}, which the scene does not have: rows were removed")
            datum = data[key]
            if datum is None:
                continue
            if datum.name in own:
                raise ValueError(f"{where} lists two data of the sensor '{datum.name}'")
            own[datum.name] = datum
        calibration = plain_name(field(row, "calibration_key", where), f"{where}: calibration_key")
        sample = DgpSample({name: own[name] for name in sorted(own)}, calibration)
        if not sample.cameras:
            raise ValueError(f"{where} has no camera images")
        return sample
