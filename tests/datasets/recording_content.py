"""Everything a recording says, pixels and points aside, as text that can be compared."""

from __future__ import annotations

from typing import Any

from coin3d.datasets.nuscenes_format import NuScenesRecording
from coin3d.geometry import Boxes3D, Pose

_BOX_FIELDS = ("centre_m", "size_m", "yaw_rad", "labels", "velocity_mps", "instance_ids", "num_lidar_points")


def content(recording: NuScenesRecording, sweeps: bool = True) -> str:
    """All frames and sweeps, to the last digit."""
    found: list[Any] = []
    for frame in recording:
        cameras = [(c, camera.K.tolist(), _pose(camera.ego_from_cam), camera.width_px) for c, camera in frame.rig.items()]
        found.append([frame.token, frame.timestamp_ns, frame.scene, frame.previous, frame.next, frame.images, cameras])
        found.append([_pose(frame.world_from_ego), _boxes(frame.boxes_world), _lidar(frame.lidar)])
        if sweeps:
            found.append([(time_ns, _lidar(file)) for time_ns, file in recording.sweeps(frame)])
    return repr(found)


def _pose(pose: Pose) -> list[Any]:
    return pose.matrix.tolist()


def _boxes(boxes: Boxes3D | None) -> Any:
    return None if boxes is None else [getattr(boxes, name).tolist() for name in _BOX_FIELDS]


def _lidar(file: Any) -> Any:
    return None if file is None else (file.path, [_pose(value) for value in vars(file).values() if isinstance(value, Pose)])
