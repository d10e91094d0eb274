"""Recordings of the Waymo Open Dataset, version 2: Parquet files, one per component and segment."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from coin3d.datasets.frame import Frame
from coin3d.datasets.frame_index import indexed
from coin3d.datasets.parquet_rows import TableFile, parquet
from coin3d.datasets.waymo_parts import WaymoInstant, checked_segment, checked_timestamp, token
from coin3d.datasets.waymo_v2_tables import (
    find_lasers,
    frame_keys,
    read_cameras,
    read_images,
    read_labels,
    read_lasers,
    read_vehicle_pose,
)

_IMAGES = "camera_image"
_NEEDED = (_IMAGES, "camera_calibration", "vehicle_pose")
_OPTIONAL = ("lidar_box", "lidar", "lidar_calibration", "lidar_pose")


@dataclass(frozen=True)
class FrameKey:
    """What the index of a file knows of a frame: name of its segment and its time."""

    segment: str
    timestamp_us: int

    def __post_init__(self) -> None:
        checked_segment(self.segment, "index")
        checked_timestamp(self.timestamp_us, "index")


class WaymoV2Recording:
    """Frames of all segments, by name of the segment and time. Of every file only what a frame needs is read.

    Reference time, ego frame and camera poses are those of ``WaymoV1Recording``. Needed are the components camera_image,
    camera_calibration and vehicle_pose; without lidar_box there are no annotations, without lidar or lidar_calibration no
    sweeps. Without lidar_pose the points of the top laser are taken to be in the frame's own vehicle frame.

    Args:
        root: folder of the components, or of one such folder per split.
        split: name of the one split to open; all by default.
        second_return: whether LiDAR sweeps hold the second returns of the light as well.

    Raises:
        FileNotFoundError: no camera images, or a needed component of a segment is missing.
        ValueError: a file is damaged, or two files hold the same frame.
        ImportError: pyarrow is not installed.
    """

    def __init__(self, root: Path | str, split: str | None = None, second_return: bool = False) -> None:
        parquet()
        self.root = Path(root)
        self.second_return = second_return
        found: dict[FrameKey, dict[str, TableFile]] = {}
        for images in _image_files(self.root, split):
            files = _components(images)
            poses = files["vehicle_pose"]
            for key in indexed(poses.path, FrameKey, partial(_keys, poses)):
                if found.setdefault(key, files) is not files:
                    raise ValueError(
                        f"{poses.path}: holds the frame {token(key.segment, key.timestamp_us)} that is in "
                        f"{found[key]['vehicle_pose'].path} as well; remove one of the copies"
                    )
        if not found:
            raise ValueError(f"{self.root}: the files of vehicle poses hold no frames; were they copied whole?")
        self._frames = sorted(found.items(), key=lambda item: (item[0].segment, item[0].timestamp_us))

    def __len__(self) -> int:
        return len(self._frames)

    def __iter__(self) -> Iterator[Frame]:
        return (self[i] for i in range(len(self)))

    def scene_names(self) -> list[str]:
        """The scene of every frame, without building frames."""
        return [key.segment for key, _ in self._frames]

    def __getitem__(self, index: int) -> Frame:
        """The frame at a position.

        Raises:
            IndexError: beyond the end.
            ValueError: a file is damaged or was changed, or a part of the frame makes no sense.
        """
        index = range(len(self))[index]
        key, files = self._frames[index]
        time, boxes = key.timestamp_us, files.get("lidar_box")
        lidar, lidar_calibration = files.get("lidar"), files.get("lidar_calibration")
        range_images = None
        if lidar is not None and lidar_calibration is not None:
            range_images = find_lasers(lidar, files.get("lidar_pose"), time)
        instant = WaymoInstant(
            segment=key.segment,
            timestamp_us=time,
            world_from_vehicle=read_vehicle_pose(files["vehicle_pose"], time),
            calibrations=read_cameras(files["camera_calibration"]),
            images=read_images(files[_IMAGES], time),
            labels=None if boxes is None else read_labels(boxes, time),
            lasers=read_lasers(lidar_calibration) if range_images is not None and lidar_calibration is not None else {},
            range_images=range_images,
            where=f"{files[_IMAGES].path}: frame {time}",
        )
        return instant.frame(self._token(index - 1, key), self._token(index + 1, key), self.root, self.second_return)

    def _token(self, index: int, neighbour: FrameKey) -> str:
        """Token of the frame at a position, or "" where another segment begins."""
        if not 0 <= index < len(self._frames) or self._frames[index][0].segment != neighbour.segment:
            return ""
        return token(neighbour.segment, self._frames[index][0].timestamp_us)


def is_waymo_v2(path: Path) -> bool:
    """Whether a folder holds camera images in Parquet files, by itself or split by split."""
    return any(next(path.glob(pattern), None) for pattern in (f"{_IMAGES}/*.parquet", f"*/{_IMAGES}/*.parquet"))


def _image_files(root: Path, split: str | None) -> list[Path]:
    if split is None:
        found = sorted((*root.glob(f"{_IMAGES}/*.parquet"), *root.glob(f"*/{_IMAGES}/*.parquet")))
    else:
        found = sorted((root / split).glob(f"{_IMAGES}/*.parquet")) if Path(split).name == split else []
    if not found:
        raise FileNotFoundError(f"{root if split is None else root / split}: no {_IMAGES}/*.parquet there")
    return found


def _components(images: Path) -> dict[str, TableFile]:
    """The files of one segment by their component."""
    folder, name = images.parents[1], images.name
    missing = [tag for tag in _NEEDED if not (folder / tag / name).is_file()]
    if missing:
        raise FileNotFoundError(f"{folder / missing[0] / name}: this file of the recording is missing; download it as well")
    return {tag: TableFile.at(folder / tag / name) for tag in (*_NEEDED, *_OPTIONAL) if (folder / tag / name).is_file()}


def _keys(poses: TableFile) -> list[FrameKey]:
    try:
        return [FrameKey(segment, time) for segment, time in frame_keys(poses)]
    except ValueError as error:
        message = str(error)
        raise ValueError(message if message.startswith(str(poses.path)) else f"{poses.path}: {message}") from error
