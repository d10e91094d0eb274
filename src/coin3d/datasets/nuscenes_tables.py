"""The tables of a nuScenes-format recording (nuScenes v1.0 schema): found on disk, and the small ones held in memory."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from coin3d.datasets.json_table import Row, Table, Tell, follow, microseconds, name, value
from coin3d.datasets.nuscenes_sensors import Sensors

TABLES = (
    "scene",
    "sample",
    "sample_data",
    "ego_pose",
    "calibrated_sensor",
    "sensor",
    "sample_annotation",
    "instance",
    "category",
)
"""The nine tables a frame needs."""


@dataclass(frozen=True)
class Sample:
    """A key frame.

    Args:
        token: of the sample.
        scene: index of its scene.
        time_us: microseconds as the table has them.
    """

    token: str
    scene: int
    time_us: int | float


@dataclass(frozen=True, eq=False)
class SmallTables:
    """The tables that grow with scenes, objects and key frames only; links between them are followed when they are needed."""

    scene: Table
    sample: Table
    calibrated_sensor: Table
    sensor: Table
    instance: Table
    category: Table

    @classmethod
    def read(cls, folder: Path, tell: Tell | None = None) -> SmallTables:
        """Read them.

        Raises:
            FileNotFoundError: a table is missing.
            ValueError: a table cannot be parsed.
        """

        def table(stem: str, *fields: str) -> Table:
            return Table(folder / f"{stem}.json", fields, tell)

        return cls(
            table("scene", "name"),
            table("sample", "timestamp", "scene_token"),
            table("calibrated_sensor", "sensor_token", "translation", "rotation", "camera_intrinsic"),
            table("sensor", "channel", "modality"),
            table("instance", "category_token"),
            table("category", "name"),
        )

    def sensors(self) -> Sensors:
        """Channels by what they are."""
        path = self.sensor.path
        pairs = [(name(path, row, "channel"), value(path, row, "modality")) for row in self.sensor.rows()]
        cameras, lidars = (frozenset(channel for channel, kind in pairs if kind == wanted) for wanted in ("camera", "lidar"))
        return Sensors(path, cameras, lidars)

    def sensor_of(self, calibration: Row) -> Row:
        """The sensor row (channel, modality) of a calibrated_sensor row."""
        return follow(self.calibrated_sensor.path, calibration, "sensor_token", self.sensor)

    def category_name(self, annotation_table: Path, annotation: Row) -> str:
        """The category of a sample_annotation row, by way of its instance."""
        instance = follow(annotation_table, annotation, "instance_token", self.instance)
        return name(self.category.path, follow(self.instance.path, instance, "category_token", self.category), "name")

    def scene_names(self) -> list[str]:
        """Names of the scenes in the order of their table."""
        return [name(self.scene.path, row, "name") for row in self.scene.rows()]

    def samples(self) -> list[Sample]:
        """All samples: scene by scene in the order of that table, in time order within a scene.

        Raises:
            ValueError: a sample without scene, a scene without samples, or no samples at all.
        """
        path = self.sample.path
        place = {row["token"]: i for i, row in enumerate(self.scene.rows())}
        found = [
            Sample(row["token"], place[follow(path, row, "scene_token", self.scene)["token"]], microseconds(path, row))
            for row in self.sample.rows()
        ]
        found.sort(key=lambda sample: (sample.scene, sample.time_us))
        used = {sample.scene for sample in found}
        for token, i in place.items():
            if i not in used:
                raise ValueError(f"{self.scene.path}: scene '{token}' has no samples; remove its row or add its samples")
        if not found:
            raise ValueError(f"{path}: the recording has no samples")
        return found


def find_version_folder(root: Path, version: str | None = None) -> Path:
    """The folder with the tables: ``root/<version>``, or the only one there is (Lyft nests it once more).

    Raises:
        FileNotFoundError: no folder with tables.
        ValueError: several, and ``version`` does not say which.
    """
    places = [root / version, root / version / version] if version else [root, *root.glob("*"), *root.glob("*/*")]
    found = sorted(p for p in places if (p / "sample.json").is_file())
    if not found:
        looked = f"{root / version}" if version else f"{root}, {root}/* and {root}/*/*"
        raise FileNotFoundError(f"{root}: no folder with nuScenes-format tables (looked for sample.json in {looked})")
    if len(found) > 1:
        names = ", ".join(str(p.relative_to(root)) for p in found)
        raise ValueError(f"{root}: several versions ({names}); say which one with version=")
    return found[0]
