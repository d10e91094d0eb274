"""Recordings in nuScenes format: nuScenes itself, Lyft Level 5, and the town. Own reader of the JSON tables."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float

from coin3d.datasets.frame import Frame
from coin3d.datasets.inside import inside
from coin3d.datasets.json_table import Row, Table
from coin3d.datasets.lidar_file import LidarFile
from coin3d.datasets.lyft_files import ZOOMED_CAMERA, data_root, locate
from coin3d.datasets.nuscenes_tables import find_version_folder, read_tables
from coin3d.datasets.own_vehicle import own_vehicle_masks
from coin3d.datasets.splits import SplitChoice, chosen_scenes
from coin3d.geometry import Boxes3D, Camera, Pose, Rig

_MAX_VELOCITY_GAP_S = 1.5
_VISIBILITY_TOKENS = {"1": 1, "2": 2, "3": 3, "4": 4}  # Lyft has ""
# nuScenes and Lyft calibrate with OpenCV, whose first pixel has its centre at 0
_OPENCV_PIXEL_SHIFT = 0.5


class NuScenesRecording:
    """Key frames of all scenes, in time order within each scene. Frames are built when asked for.

    The reference time of a frame is that of its LiDAR key frame, and its ego frame is the LiDAR's ego pose then
    (without LiDAR: the first camera's). Camera poses contain the ego motion between that time and their own
    (``time_sync = pose``). Only links that a frame needs must resolve; ``prev`` and ``next`` of the samples are not
    read, the order in time is used instead, so cut-out recordings open as well.

    Args:
        root: the folder that the tables' file names are relative to.
        version: name of the folder with the tables; may be left out where there is exactly one.
        split: which scenes: the name of a split of nuScenes or Lyft, a text file, or scene names; by default all.
        cameras: which channels; by default all but Lyft's ``CAM_FRONT_ZOOMED``.

    Raises:
        FileNotFoundError: no tables, or one is missing.
        ValueError: a table is damaged, a token dangles, a scene is empty, no sample has a camera, or the recording has no such
            split or camera.
    """

    def __init__(
        self,
        root: Path | str,
        version: str | None = None,
        split: SplitChoice | None = None,
        cameras: Collection[str] | None = None,
    ) -> None:
        root = Path(root)
        folder = find_version_folder(root, version)
        self._tables = read_tables(folder)
        self._channels = self._tables.camera_channels(cameras, leave_out=(ZOOMED_CAMERA,))
        self.root = data_root(root, folder, self._tables.any_filename())
        self._key_data = self._tables.key_data_by_sample()
        self._annotations = self._tables.annotations_by_sample()
        self._calibrated_cameras: dict[tuple[str, int, int], Camera] = {}
        self._samples: list[Row] = []
        self._neighbours: list[tuple[str, str]] = []
        by_scene = self._tables.samples_by_scene()
        names = {token: self._scene_name(samples[0]) for token, samples in by_scene.items()}
        chosen = set(chosen_scenes(split, list(names.values()), str(folder)))
        for token, samples in by_scene.items():
            if names[token] not in chosen:
                continue
            tokens = ["", *(s["token"] for s in samples), ""]
            self._neighbours += zip(tokens[:-2], tokens[2:], strict=True)
            self._samples += samples
        self._index = {sample["token"]: i for i, sample in enumerate(self._samples)}
        if not self._samples:
            raise ValueError(f"{self._tables.sample.path}: the recording has no samples")

    def __len__(self) -> int:
        return len(self._samples)

    def __iter__(self) -> Iterator[Frame]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, index: int) -> Frame:
        """The frame at a position.

        Raises:
            IndexError: beyond the end.
            ValueError: the calibration, a pose or an annotation of this frame makes no sense.
        """
        sample = self._samples[index]
        token = sample["token"]
        data = self._key_data.get(token, {})
        cameras = self._tables.cameras_in_order(self._channels & set(data))
        if not cameras:
            raise ValueError(f"{self._tables.sample_data.path}: sample '{token}' has no camera images")
        lidar = self._tables.lidar_of(data)
        reference = data[lidar or cameras[0]]
        world_from_ego = self._world_from_ego(reference)
        previous, following = self._neighbours[index]
        return Frame(
            token=token,
            timestamp_ns=_nanoseconds(self._tables.sample_data, reference),
            rig=self._rig({c: data[c] for c in cameras}, world_from_ego),
            images={c: self._path(data[c]) for c in cameras},
            world_from_ego=world_from_ego,
            boxes_world=self._boxes_world(token),
            lidar=LidarFile(self._path(data[lidar]), self._ego_from_sensor(data[lidar])) if lidar else None,
            scene=self._scene_name(sample),
            previous=previous,
            next=following,
            own_vehicle=own_vehicle_masks(self.root, cameras),
        )

    def scene_names(self) -> list[str]:
        """The scene of every frame, without building frames."""
        return [self._scene_name(sample) for sample in self._samples]

    def frame_by_token(self, token: str) -> Frame:
        """The frame of a sample token.

        Raises:
            KeyError: no such sample.
        """
        if token not in self._index:
            raise KeyError(f"{self._tables.sample.path}: no sample '{token}'")
        return self[self._index[token]]

    def sweeps(self, frame: Frame) -> list[tuple[int, LidarFile]]:
        """LiDAR sweeps after a frame and before the next key frame, as (timestamp in ns, file).

        Their points come out in the ego frame of ``frame``, so that what stands still overlaps.
        """
        inside = []
        for row in self._sweeps_by_scene.get(frame.scene, []):
            time_ns = _nanoseconds(self._tables.sample_data, row)
            if time_ns > frame.timestamp_ns:
                if row["is_key_frame"]:
                    break
                ego_from_ego_then = frame.world_from_ego.inverse() @ self._world_from_ego(row)
                inside.append((time_ns, LidarFile(self._path(row), ego_from_ego_then @ self._ego_from_sensor(row))))
        return inside

    @cached_property
    def _sweeps_by_scene(self) -> dict[str, list[Row]]:
        tables = self._tables
        channel = tables.lidar_of({row["channel"] for row in tables.sensor.rows()})
        groups: dict[str, list[Row]] = {}
        for row in tables.sample_data.rows():
            if tables.sensor_of(row)["channel"] == channel:
                sample = tables.sample_data.follow(row, "sample_token", tables.sample)
                groups.setdefault(self._scene_name(sample), []).append(row)
        for rows in groups.values():
            rows.sort(key=lambda row: tables.sample_data.value(row, "timestamp"))
        return groups

    def _scene_name(self, sample: Row) -> str:
        tables = self._tables
        return str(tables.scene.value(tables.sample.follow(sample, "scene_token", tables.scene), "name"))

    def _path(self, data: Row) -> Path:
        name = self._tables.sample_data.value(data, "filename")
        inside(self.root, name, f"{self._tables.sample_data.path}: row '{data['token']}': filename")
        return locate(self.root, name)

    def _world_from_ego(self, data: Row) -> Pose:
        return _pose(self._tables.ego_pose, self._tables.sample_data.follow(data, "ego_pose_token", self._tables.ego_pose))

    def _ego_from_sensor(self, data: Row) -> Pose:
        return _pose(self._tables.calibrated_sensor, self._tables.calibration(data))

    def _rig(self, data: dict[str, Row], world_from_ego: Pose) -> Rig:
        try:
            return Rig({c: self._camera(row, world_from_ego) for c, row in data.items()}, name=self.root.name)
        except ValueError as error:
            message = str(error)
            located = message.startswith(str(self._tables.calibrated_sensor.path.parent))
            raise ValueError(message if located else f"{self._tables.calibrated_sensor.path}: {message}") from error

    def _camera(self, data: Row, world_from_ego: Pose) -> Camera:
        camera = self._calibrated_camera(data)
        ego_from_ego_at_trigger = world_from_ego.inverse() @ self._world_from_ego(data)
        return camera.moved(ego_from_ego_at_trigger @ camera.ego_from_cam)

    def _calibrated_camera(self, data: Row) -> Camera:
        """The camera as calibrated (no ego motion), parsed once per calibration and image size."""
        row, table = self._tables.calibration(data), self._tables.calibrated_sensor
        width, height = (int(self._tables.sample_data.value(data, side)) for side in ("width", "height"))
        key = (row["token"], width, height)
        if key not in self._calibrated_cameras:
            try:
                K = np.array(table.value(row, "camera_intrinsic"), dtype=np.float64)
                if K.shape != (3, 3):
                    raise ValueError(f"camera_intrinsic is a 3 x 3 matrix, got shape {K.shape}")
                K[:2, 2] += _OPENCV_PIXEL_SHIFT
                self._calibrated_cameras[key] = Camera(K, width, height, _pose(table, row))
            except (ValueError, TypeError) as error:
                raise ValueError(_located(table, row, error)) from error
        return self._calibrated_cameras[key]

    def _boxes_world(self, sample_token: str) -> Boxes3D | None:
        table = self._tables.sample_annotation
        if not len(table):
            return None
        rows = self._annotations.get(sample_token, [])
        if not rows:
            return Boxes3D.empty()
        poses = [_pose(table, row) for row in rows]
        try:
            width_length_height = np.array([table.value(row, "size") for row in rows], dtype=np.float64).reshape(-1, 3)
            return Boxes3D.create(
                np.stack([pose.translation for pose in poses]),
                width_length_height[:, [1, 0, 2]],
                np.array([pose.yaw_rad for pose in poses]),
                [self._tables.category_name(row) for row in rows],
                velocity_mps=np.stack([self._velocity_mps(row) for row in rows]),
                instance_ids=[str(row["instance_token"]) for row in rows],
                num_lidar_points=[int(row.get("num_lidar_pts", -1)) for row in rows],
                visibility=[_VISIBILITY_TOKENS.get(str(row.get("visibility_token")), 0) for row in rows],
            )
        except (ValueError, TypeError) as error:
            raise ValueError(f"{table.path}: annotations of sample '{sample_token}': {error}") from error

    def _velocity_mps(self, row: Row) -> Float[np.ndarray, "2"]:
        """Centred difference over the neighbouring annotations, one-sided at the ends of a track, else NaN."""
        table = self._tables.sample_annotation
        time_s = self._annotation_time_s(row)
        first = last = row
        for link in ("prev", "next"):
            neighbour = table.find(row.get(link, ""))
            if neighbour is not None and abs(self._annotation_time_s(neighbour) - time_s) <= _MAX_VELOCITY_GAP_S:
                first, last = (neighbour, last) if link == "prev" else (first, neighbour)
        elapsed_s = self._annotation_time_s(last) - self._annotation_time_s(first)
        if elapsed_s <= 0:
            return np.full(2, np.nan)
        moved = np.subtract(table.value(last, "translation"), table.value(first, "translation"))
        return np.asarray(moved[:2] / elapsed_s)

    def _annotation_time_s(self, row: Row) -> float:
        sample = self._tables.sample_annotation.follow(row, "sample_token", self._tables.sample)
        return float(self._tables.sample.value(sample, "timestamp")) * 1e-6


def _nanoseconds(table: Table, row: Row) -> int:
    # microseconds in the file; Lyft writes them with decimals
    return round(float(table.value(row, "timestamp"))) * 1000


def _pose(table: Table, row: Row) -> Pose:
    """target_from_source of a row with a (w, x, y, z) quaternion and a translation in metres."""
    try:
        return Pose.from_quaternion(table.value(row, "rotation"), table.value(row, "translation"))
    except (ValueError, TypeError) as error:
        raise ValueError(_located(table, row, error)) from error


def _located(table: Table, row: Row, error: Exception) -> str:
    message = str(error)
    return message if message.startswith(str(table.path)) else f"{table.path}: row '{row['token']}': {message}"
