"""One scene of a DGP recording: its samples in time order, each a set of data with a pose of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from coin3d.datasets.dgp_files import Calibration, field, read_calibration, read_json, read_pose, read_time_ns
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
        return self.folder / str(field(self.content, "filename", self.where))

    @property
    def boxes_path(self) -> Path | None:
        """Its 3D annotations, if there are any."""
        name = (self.content.get("annotations") or {}).get(_BOXES_3D)
        return None if name is None else self.folder / str(name)

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
        self._ontologies: Mapping[str, str] = content.get("ontologies") or {}
        self._calibrations: dict[str, Calibration] = {}
        data = {d.key: d for d in (self._datum(row) for row in field(content, "data", str(path))) if d is not None}
        listed = {str(row.get("key")) for row in content["data"]}
        self.samples = [self._sample(row, n, data, listed) for n, row in enumerate(field(content, "samples", str(path)))]
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
        key = field(self._ontologies, _BOXES_3D, f"{self.path}: ontologies")
        path = self.folder / "ontology" / f"{key}.json"
        items = field(read_json(path), "items", str(path))
        return {int(field(item, "id", str(path))): str(field(item, "name", str(path))) for item in items}

    def _datum(self, row: Any) -> Datum | None:
        where = f"{self.path}: datum '{row.get('key') if isinstance(row, dict) else row}'"
        identity, kinds = field(row, "id", where), field(row, "datum", where)
        kind = next((k for k in ("image", "point_cloud") if k in kinds), None)
        if kind is None:
            return None  # radar and other sensors
        time_ns = read_time_ns(field(identity, "timestamp", where), where)
        name = str(field(identity, "name", where))
        return Datum(str(field(row, "key", where)), name, kind, time_ns, kinds[kind], self.folder, where)

    def _sample(self, row: Any, number: int, data: Mapping[str, Datum], listed: set[str]) -> DgpSample:
        where = f"{self.path}: sample {number}"
        keys = [str(key) for key in field(row, "datum_keys", where)]
        if dangling := [key for key in keys if key not in listed]:
            raise ValueError(f"{where} lists the datum '{dangling[0]}', which the scene does not have: rows were removed")
        own = {data[key].name: data[key] for key in keys if key in data}
        sample = DgpSample({name: own[name] for name in sorted(own)}, str(field(row, "calibration_key", where)))
        if not sample.cameras:
            raise ValueError(f"{where} has no camera images")
        return sample
