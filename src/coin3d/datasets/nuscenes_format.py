"""Recordings in nuScenes format: nuScenes itself, Lyft Level 5, and the town. Own reader of the JSON tables."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Collection, Iterator
from itertools import accumulate
from pathlib import Path

import numpy as np
from jaxtyping import Float

from coin3d.datasets.frame import Frame
from coin3d.datasets.inside import inside
from coin3d.datasets.json_table import Row, microseconds, numbers, refused, value
from coin3d.datasets.json_values import shown
from coin3d.datasets.lidar_file import LidarFile
from coin3d.datasets.lyft_files import ZOOMED_CAMERA, data_root, locate
from coin3d.datasets.nuscenes_index import TablesIndex
from coin3d.datasets.nuscenes_tables import find_version_folder
from coin3d.datasets.own_vehicle import own_vehicle_masks
from coin3d.datasets.splits import SplitChoice, chosen_scenes
from coin3d.datasets.table_progress import to_stderr
from coin3d.geometry import Boxes3D, Camera, Pose, Rig
from coin3d.geometry.pose import headings

_MOST_PIXELS = 1 << 16
_VISIBILITY_TOKENS = {"1": 1, "2": 2, "3": 3, "4": 4}  # Lyft has ""
# nuScenes and Lyft calibrate with OpenCV, whose first pixel has its centre at 0
_OPENCV_PIXEL_SHIFT = 0.5


class NuScenesRecording:
    """Key frames of all scenes, in time order within each scene. Frames are built when asked for.

    The tables are read once and joined into an index (``nuscenes_index``); a frame is one record of it.

    The reference time of a frame is that of its LiDAR key frame, and its ego frame is the LiDAR's ego pose then
    (without LiDAR: the first camera's). Camera poses contain the ego motion between that time and their own
    (``time_sync = pose``). Only links that a frame needs must resolve; ``prev`` and ``next`` of the samples are not
    read, the order in time is used instead, so cut-out recordings open as well.

    Args:
        root: the folder that the tables' file names are relative to.
        version: name of the folder with the tables; may be left out where there is exactly one.
        split: which scenes: the name of a split of nuScenes or Lyft, a text file, or scene names; by default all.
        cameras: which channels; by default all but Lyft's ``CAM_FRONT_ZOOMED``.
        progress: called with a line now and then while the index of large tables is made; by default they go to stderr.

    Raises:
        FileNotFoundError: no tables, or one is missing.
        ValueError: a table is damaged, a token dangles, a scene is empty, no sample has a camera, or the recording has no such
            split or camera.
        OSError: there is no room for the temporary files that joining large tables takes.
    """

    def __init__(
        self,
        root: Path | str,
        version: str | None = None,
        split: SplitChoice | None = None,
        cameras: Collection[str] | None = None,
        *,
        progress: Callable[[str], None] = to_stderr,
    ) -> None:
        root = Path(root)
        folder = find_version_folder(root, version)
        self._index = TablesIndex(folder, progress)
        self._sample_data, self._ego_pose, self._calibrated_sensor, self._sample_annotation = (
            folder / f"{table}.json" for table in ("sample_data", "ego_pose", "calibrated_sensor", "sample_annotation")
        )
        self._channels = self._index.sensors.camera_channels(cameras, leave_out=(ZOOMED_CAMERA,))
        self.root = data_root(root, folder, self._index.some_filename)
        self._calibrated_cameras: dict[tuple[int, int, int], Camera] = {}
        self._folder = folder
        chosen = set(chosen_scenes(split, [scene.name for scene in self._index.scenes], str(folder)))
        self._scenes = [scene for scene in self._index.scenes if scene.name in chosen]
        # index of the first frame of every chosen scene, and of the end
        self._starts = [0, *accumulate(scene.frames for scene in self._scenes)]

    def __len__(self) -> int:
        return self._starts[-1]

    def __iter__(self) -> Iterator[Frame]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, index: int) -> Frame:
        """The frame at a position.

        Raises:
            IndexError: beyond the end.
            ValueError: the calibration, a pose or an annotation of this frame makes no sense.
        """
        at = range(len(self))[index]
        place = bisect_right(self._starts, at) - 1
        scene = self._scenes[place]
        record = self._index.frame(scene.first + at - self._starts[place])
        token, data = record["token"], record["data"]
        cameras = self._index.sensors.cameras_in_order(self._channels & set(data))
        if not cameras:
            raise ValueError(f"{self._sample_data}: sample '{token}' has no camera images")
        lidar = self._index.sensors.lidar_of(data)
        reference = data[lidar or cameras[0]]
        world_from_ego = _pose(self._ego_pose, reference["pose"])
        return Frame(
            token=token,
            timestamp_ns=round(float(microseconds(self._sample_data, reference["row"]))) * 1000,
            rig=self._rig({c: data[c] for c in cameras}, world_from_ego),
            images={c: self._path(data[c]["row"]) for c in cameras},
            world_from_ego=world_from_ego,
            boxes_world=self._boxes_world(token, record["annotations"], record["velocities"]),
            lidar=LidarFile(self._path(data[lidar]["row"]), self._ego_from_sensor(data[lidar])) if lidar else None,
            scene=scene.name,
            previous=record["previous"],
            next=record["next"],
            own_vehicle=own_vehicle_masks(self.root, cameras),
        )

    def scene_names(self) -> list[str]:
        """The scene of every frame, without building frames."""
        return [scene.name for scene in self._scenes for _ in range(scene.frames)]

    def frame_by_token(self, token: str) -> Frame:
        """The frame of a sample token.

        Raises:
            KeyError: no such sample.
        """
        position = self._index.position_of(token)
        if position is not None:
            for scene, start in zip(self._scenes, self._starts, strict=False):
                if scene.first <= position < scene.first + scene.frames:
                    return self[start + position - scene.first]
        raise KeyError(f"{self._folder / 'sample.json'}: no sample '{token}'")

    def sweeps(self, frame: Frame) -> list[tuple[int, LidarFile]]:
        """LiDAR sweeps after a frame and before the next key frame, as (timestamp in ns, file).

        Their points come out in the ego frame of ``frame``, so that what stands still overlaps.

        Raises:
            ValueError: a link, a pose or the file name of a sweep makes no sense.
        """
        scene = next((scene for scene in self._index.scenes if scene.name == frame.scene), None)
        found = []
        for sweep in self._index.sweeps_between(scene, frame.timestamp_ns) if scene else []:
            if isinstance(sweep["pose"], str):
                raise ValueError(sweep["pose"])
            ego_from_ego_then = frame.world_from_ego.inverse() @ _pose(self._ego_pose, sweep["pose"])
            file = LidarFile(self._path(sweep["row"]), ego_from_ego_then @ self._ego_from_sensor(sweep))
            found.append((sweep["time_ns"], file))
        return found

    def _path(self, data: Row) -> Path:
        name = value(self._sample_data, data, "filename")
        inside(self.root, name, f"{self._sample_data}: row '{data['token']}': filename")
        return locate(self.root, name)

    def _ego_from_sensor(self, data: Row) -> Pose:
        return _pose(self._calibrated_sensor, self._index.calibration(data["calibration"]))

    def _rig(self, data: dict[str, Row], world_from_ego: Pose) -> Rig:
        try:
            return Rig({c: self._camera(entry, world_from_ego) for c, entry in data.items()}, name=self.root.name)
        except ValueError as error:
            message = str(error)
            located = message.startswith(str(self._folder))
            raise ValueError(message if located else f"{self._calibrated_sensor}: {message}") from error

    def _camera(self, data: Row, world_from_ego: Pose) -> Camera:
        camera = self._calibrated_camera(data)
        ego_from_ego_at_trigger = world_from_ego.inverse() @ _pose(self._ego_pose, data["pose"])
        return camera.moved(ego_from_ego_at_trigger @ camera.ego_from_cam)

    def _calibrated_camera(self, data: Row) -> Camera:
        """The camera as calibrated (no ego motion), parsed once per calibration and image size."""
        width, height = (_pixels(self._sample_data, data["row"], side) for side in ("width", "height"))
        key = (data["calibration"], width, height)
        if key not in self._calibrated_cameras:
            row, table = self._index.calibration(data["calibration"]), self._calibrated_sensor
            try:
                K = numbers(value(table, row, "camera_intrinsic"))
                if K.shape != (3, 3):
                    raise ValueError(f"camera_intrinsic is a 3 x 3 matrix, got shape {K.shape}")
                K[:2, 2] += _OPENCV_PIXEL_SHIFT
                self._calibrated_cameras[key] = Camera(K, width, height, _pose(table, row))
            except ValueError as error:
                raise ValueError(_located(table, row, error)) from error
        return self._calibrated_cameras[key]

    def _boxes_world(self, sample_token: str, rows: list[Row], velocities: list[list[float] | str | None]) -> Boxes3D | None:
        table = self._sample_annotation
        if not self._index.labelled:
            return None
        if not rows:
            return Boxes3D.empty()
        centres_m, sizes_m, yaws_rad = _placed(table, rows)
        try:
            if problem := next((v for v in velocities if isinstance(v, str)), None):
                raise ValueError(problem)
            return Boxes3D.create(
                centres_m,
                sizes_m[:, [1, 0, 2]],  # width, length, height in the file
                yaws_rad,
                [row["category"] for row in rows],
                velocity_mps=[(np.nan, np.nan) if v is None else v for v in velocities],
                instance_ids=[row["instance_token"] for row in rows],
                num_lidar_points=[_point_count(table, row) for row in rows],
                visibility=[_VISIBILITY_TOKENS.get(str(row.get("visibility_token")), 0) for row in rows],
            )
        except ValueError as error:
            raise ValueError(f"{table}: annotations of sample '{sample_token}': {error}") from error


def _pixels(path: Path, row: Row, side: str) -> int:
    """The width or height of an image."""
    found = value(path, row, side)
    if isinstance(found, bool) or not isinstance(found, int | float) or not 1 <= found <= _MOST_PIXELS or found % 1:
        raise refused(
            path, row, f"has the {side} {shown(found)}, which should be a whole number of pixels up to {_MOST_PIXELS}"
        )
    return int(found)


def _placed(path: Path, rows: list[Row]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Float[np.ndarray, "n"]]:
    """Centres, sizes as in the file, and headings of annotations.

    All at once: a ``Pose`` of each takes half the time of a frame.
    """
    try:
        columns = [numbers([value(path, row, field) for row in rows]) for field in ("translation", "size", "rotation")]
        if [c.shape for c in columns] == [(len(rows), 3), (len(rows), 3), (len(rows), 4)] and np.isfinite(columns[0]).all():
            return columns[0], columns[1], headings(columns[2])
    except ValueError:
        pass  # one by one, the row that makes no sense is found
    poses, sizes_m = [_pose(path, row) for row in rows], [_size(path, row) for row in rows]
    return np.stack([p.translation for p in poses]), np.stack(sizes_m), np.array([p.yaw_rad for p in poses])


def _size(path: Path, row: Row) -> Float[np.ndarray, "3"]:
    """Width, length, height of an annotation."""
    try:
        found = numbers(value(path, row, "size"))
    except ValueError as error:
        raise ValueError(_located(path, row, error)) from error
    if found.shape != (3,):
        raise refused(path, row, f"has the size {shown(row['size'])}, which should be width, length, height")
    return found


def _point_count(path: Path, row: Row) -> int:
    """LiDAR points in a box, -1 where nobody counted."""
    found = row.get("num_lidar_pts", -1)
    if isinstance(found, bool) or not isinstance(found, int) or not -1 <= found < 2**31:
        raise refused(path, row, f"has the num_lidar_pts {shown(found)}, which should be a count, or -1")
    return found


def _pose(path: Path, row: Row) -> Pose:
    """target_from_source of a row with a (w, x, y, z) quaternion and a translation in metres."""
    try:
        return Pose.from_quaternion(numbers(value(path, row, "rotation")), numbers(value(path, row, "translation")))
    except ValueError as error:
        raise ValueError(_located(path, row, error)) from error


def _located(path: Path, row: Row, error: Exception) -> str:
    message = str(error)
    return message if message.startswith(str(path)) else f"{path}: row '{row['token']}': {message}"
