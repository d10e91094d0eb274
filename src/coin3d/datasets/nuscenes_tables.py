"""The tables of a nuScenes-format recording (nuScenes v1.0 schema), found on disk and joined by token."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable
from dataclasses import dataclass, fields
from pathlib import Path

from coin3d.datasets.json_table import Row, Table

_CAMERA_ORDER = ("CAM_FRONT", "CAM_FRONT_LEFT", "CAM_FRONT_RIGHT", "CAM_BACK", "CAM_BACK_LEFT", "CAM_BACK_RIGHT")


@dataclass(frozen=True, eq=False)
class NuScenesTables:
    """The nine tables a frame needs; every link between them is checked by ``read_tables``."""

    scene: Table
    sample: Table
    sample_data: Table
    ego_pose: Table
    calibrated_sensor: Table
    sensor: Table
    sample_annotation: Table
    instance: Table
    category: Table

    def calibration(self, data: Row) -> Row:
        """The calibrated_sensor row of a sample_data row."""
        return self.sample_data.follow(data, "calibrated_sensor_token", self.calibrated_sensor)

    def sensor_of(self, data: Row) -> Row:
        """The sensor row (channel, modality) of a sample_data row."""
        return self.calibrated_sensor.follow(self.calibration(data), "sensor_token", self.sensor)

    def category_name(self, annotation: Row) -> str:
        """The category of a sample_annotation row, by way of its instance."""
        instance = self.sample_annotation.follow(annotation, "instance_token", self.instance)
        return str(self.category.value(self.instance.follow(instance, "category_token", self.category), "name"))

    def samples_by_scene(self) -> dict[str, list[Row]]:
        """Scene token -> its samples in time order, scenes in table order.

        Raises:
            ValueError: a sample without scene, or a scene without samples.
        """
        groups: dict[str, list[Row]] = {row["token"]: [] for row in self.scene.rows()}
        for sample in self.sample.rows():
            groups[self.sample.follow(sample, "scene_token", self.scene)["token"]].append(sample)
        for token, samples in groups.items():
            if not samples:
                raise ValueError(f"{self.scene.path}: scene '{token}' has no samples; remove its row or add its samples")
            samples.sort(key=lambda row: self.sample.value(row, "timestamp"))
        return groups

    def key_data_by_sample(self) -> dict[str, dict[str, Row]]:
        """Sample token -> channel -> sample_data row, key frames only (the joins the files do not hold).

        Raises:
            ValueError: a token that dangles.
        """
        groups: dict[str, dict[str, Row]] = defaultdict(dict)
        for data in self.sample_data.rows():
            if self.sample_data.value(data, "is_key_frame"):
                sample = self.sample_data.follow(data, "sample_token", self.sample)
                self.sample_data.follow(data, "ego_pose_token", self.ego_pose)
                groups[sample["token"]][self.sensor_of(data)["channel"]] = data
        return dict(groups)

    def annotations_by_sample(self) -> dict[str, list[Row]]:
        """Sample token -> its annotations.

        Raises:
            ValueError: a token that dangles.
        """
        groups: dict[str, list[Row]] = defaultdict(list)
        for annotation in self.sample_annotation.rows():
            sample = self.sample_annotation.follow(annotation, "sample_token", self.sample)
            self.category_name(annotation)
            groups[sample["token"]].append(annotation)
        return dict(groups)

    def cameras_in_order(self, channels: Iterable[str]) -> list[str]:
        """Camera channels: nuScenes' six first, in their usual order, then others by name."""
        cameras = {row["channel"] for row in self.sensor.rows() if row["modality"] == "camera"} & set(channels)
        return [c for c in _CAMERA_ORDER if c in cameras] + sorted(cameras - set(_CAMERA_ORDER))

    def camera_channels(self, wanted: Collection[str] | None, leave_out: Collection[str]) -> set[str]:
        """The channels to read: what is wanted, or all cameras there are without those to leave out.

        Raises:
            ValueError: a wanted camera that the recording does not know.
        """
        there = {row["channel"] for row in self.sensor.rows() if row["modality"] == "camera"}
        if wanted is None:
            return there - set(leave_out)
        if missing := sorted(set(wanted) - there):
            raise ValueError(f"{self.sensor.path}: no camera {', '.join(missing)}, only {', '.join(sorted(there))}")
        return set(wanted)

    def any_filename(self) -> str:
        """The file name of some sample, "" where there are none."""
        return next((str(row.get("filename", "")) for row in self.sample_data.rows()), "")

    def lidar_of(self, channels: Iterable[str]) -> str | None:
        """LIDAR_TOP, else the first other LiDAR by name, else nothing."""
        lidars = sorted({row["channel"] for row in self.sensor.rows() if row["modality"] == "lidar"} & set(channels))
        return "LIDAR_TOP" if "LIDAR_TOP" in lidars else next(iter(lidars), None)


def read_tables(folder: Path) -> NuScenesTables:
    """Parse the JSON files of a version folder.

    Raises:
        FileNotFoundError: a table is missing.
        ValueError: a table cannot be parsed.
    """
    return NuScenesTables(*(Table(folder / f"{field.name}.json") for field in fields(NuScenesTables)))


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
