"""Mistakes people make with recordings, put into sound ones: each changes frames as they are read."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from coin3d.check.finding import Subject
from coin3d.datasets.frame import Frame, LidarScan, Recording
from coin3d.datasets.image_source import load_image
from coin3d.geometry import Boxes3D, Camera, Pose, Rig

LIDAR, BOXES, MOVES, MORE_FRAMES, PAIR = "lidar", "boxes", "moves", "more frames", "cameras alike"

Change = Callable[[Recording, int], Frame]


@dataclass(frozen=True, eq=False)
class Changed:
    """A recording of which every frame is changed."""

    recording: Recording
    change: Change

    def __len__(self) -> int:
        return len(self.recording)

    def __iter__(self) -> Iterator[Frame]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, index: int) -> Frame:
        return self.change(self.recording, index)


@dataclass(frozen=True)
class Held:
    """A sweep in memory."""

    scan: LidarScan

    def load(self) -> LidarScan:
        return self.scan


@dataclass(frozen=True)
class Mistake:
    """One kind.

    Args:
        name: for the table.
        subjects: a finding about one of these catches it.
        change: puts it in.
        needs: what a recording must have for it to be a mistake at all.
    """

    name: str
    subjects: tuple[Subject, ...]
    change: Change
    needs: tuple[str, ...] = ()


def _boxes(change: Callable[[Boxes3D, Frame], Boxes3D]) -> Change:
    def changed(recording: Recording, index: int) -> Frame:
        frame = recording[index]
        return frame if frame.boxes_world is None else frame.with_boxes_world(change(frame.boxes_world, frame))

    return changed


def _cameras(change: Callable[[str, Camera], Camera], only_first: bool = False) -> Change:
    def changed(recording: Recording, index: int) -> Frame:
        frame = recording[index]
        first = next(iter(frame.rig))
        cameras = {n: change(n, c) if n == first or not only_first else c for n, c in frame.rig.items()}
        return replace(frame, rig=Rig(cameras, frame.rig.ground, frame.rig.ego_from_vehicle, frame.rig.name))

    return changed


def _lidar(change: Callable[[LidarScan], LidarScan]) -> Change:
    def changed(recording: Recording, index: int) -> Frame:
        frame = recording[index]
        return frame if frame.lidar is None else replace(frame, lidar=Held(change(frame.lidar.load())))

    return changed


def _pose(change: Callable[[Pose], Pose]) -> Callable[[str, Camera], Camera]:
    return lambda _, camera: camera.moved(change(camera.ego_from_cam))


def _reordered(pose: Pose) -> Pose:
    w, x, y, z = pose.quaternion
    return Pose.from_quaternion([x, y, z, w], pose.translation)


def _of_other_size(_: str, camera: Camera) -> Camera:
    return replace(camera, K=np.diag([2.0, 2.0, 1.0]) @ camera.K)


def _turned(scan: LidarScan, pose: Pose) -> LidarScan:
    return LidarScan(pose.apply(scan.points_ego), scan.intensity, pose.apply(scan.origin_ego))


def _sensor_for_ego(scan: LidarScan) -> LidarScan:
    return LidarScan(scan.points_ego - scan.origin_ego, scan.intensity, np.zeros(3))


def _boxes_of_next(recording: Recording, index: int) -> Frame:
    frame, later = recording[index], recording[(index + 1) % len(recording)]
    return frame.with_boxes_world(later.boxes_world)


def _images_of_next(recording: Recording, index: int) -> Frame:
    frame, later = recording[index], recording[(index + 1) % len(recording)]
    return replace(frame, images={name: later.images[name] for name in frame.rig})


def _images_swapped(recording: Recording, index: int) -> Frame:
    frame = recording[index]
    first, second = _alike(frame.rig)
    images = dict(frame.images)
    images[first], images[second] = images[second], images[first]
    return replace(frame, images=images)


def _alike(rig: Rig) -> tuple[str, str]:
    """Two cameras whose images have the same size, far from each other."""
    names = list(rig)
    pairs = [(a, b) for a in names for b in names if a < b and _size(rig[a]) == _size(rig[b])]
    return max(pairs, key=lambda pair: abs(np.sin((rig[pair[0]].yaw_rad - rig[pair[1]].yaw_rad) / 2)))


def _size(camera: Camera) -> tuple[int, int]:
    return camera.width_px, camera.height_px


def _mirrored(recording: Recording, index: int) -> Frame:
    frame = recording[index]
    return replace(frame, images={name: load_image(source)[:, ::-1].copy() for name, source in frame.images.items()})


def _lowered(recording: Recording, index: int) -> Frame:
    """Everything is told from a point 0.6 m above the ground."""
    frame, down = recording[index], Pose(np.eye(3), np.array([0.0, 0.0, -0.6]))
    cameras = {n: c.moved(down @ c.ego_from_cam) for n, c in frame.rig.items()}
    lowered = replace(frame, rig=Rig(cameras), world_from_ego=frame.world_from_ego @ down.inverse())
    return lowered if frame.lidar is None else replace(lowered, lidar=Held(_turned(frame.lidar.load(), down)))


def _late(recording: Recording, index: int) -> Frame:
    frame = recording[index]
    return replace(frame, timestamp_ns=frame.timestamp_ns + (3_000_000_000 if index >= len(recording) // 2 else 0))


def _poses_inverted(recording: Recording, index: int) -> Frame:
    frame = recording[index]
    boxes = None if frame.boxes is None else frame.boxes.transformed(frame.world_from_ego.inverse())
    return replace(frame, world_from_ego=frame.world_from_ego.inverse(), boxes_world=boxes)


def _upside_down(pose: Pose) -> Pose:
    return pose @ Pose(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))


def _axes(pose: Pose) -> Pose:
    """Axes x forward, y left, z up where x right, y down, z forward is meant."""
    axes = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
    return Pose(pose.rotation @ axes, pose.translation)


def _yawed(pose: Pose) -> Pose:
    turn = Pose.from_euler(np.deg2rad(6.0), 0, 0, np.zeros(3))
    return Pose(turn.rotation @ pose.rotation, pose.translation)


def _swapped(boxes: Boxes3D, _: Frame) -> Boxes3D:
    return replace(boxes, size_m=boxes.size_m[:, [1, 0, 2]])


def _other_sign(boxes: Boxes3D, _: Frame) -> Boxes3D:
    return replace(boxes, yaw_rad=-boxes.yaw_rad)


def _from_y(boxes: Boxes3D, _: Frame) -> Boxes3D:
    return replace(boxes, yaw_rad=boxes.yaw_rad + np.pi / 2)


def _at_bottom(boxes: Boxes3D, _: Frame) -> Boxes3D:
    return replace(boxes, centre_m=boxes.centre_m - boxes.size_m * [0, 0, 0.5])


def _ego_for_world(boxes: Boxes3D, frame: Frame) -> Boxes3D:
    return boxes.transformed(frame.world_from_ego.inverse())


def _quarter_turn(scan: LidarScan) -> LidarScan:
    return _turned(scan, Pose.from_euler(np.pi / 2, 0, 0, np.zeros(3)))


def _millimetres(pose: Pose) -> Pose:
    return Pose(pose.rotation, 1000 * pose.translation)


MISTAKES = (
    Mistake("boxes: length and width swapped", ("boxes",), _boxes(_swapped), (BOXES, LIDAR)),
    Mistake("boxes: sign of yaw", ("boxes",), _boxes(_other_sign), (BOXES, LIDAR)),
    Mistake("boxes: yaw from the y axis", ("boxes",), _boxes(_from_y), (BOXES, LIDAR)),
    Mistake("boxes: centre of the bottom", ("boxes",), _boxes(_at_bottom), (BOXES, LIDAR)),
    Mistake("boxes: ego frame for world", ("boxes",), _boxes(_ego_for_world), (BOXES, LIDAR)),
    Mistake("boxes: of the next frame", ("boxes",), _boxes_of_next, (BOXES, LIDAR, MOVES)),
    Mistake("camera: cam_from_ego for ego_from_cam", ("cameras",), _cameras(_pose(Pose.inverse))),
    Mistake("camera: axes x forward", ("cameras",), _cameras(_pose(_axes))),
    Mistake("camera: upside down", ("cameras",), _cameras(_pose(_upside_down), only_first=True)),
    Mistake("camera: quaternion x, y, z, w", ("cameras",), _cameras(_pose(_reordered))),
    Mistake("camera: millimetres", ("cameras",), _cameras(_pose(_millimetres))),
    Mistake("camera: K of another image size", ("cameras",), _cameras(_of_other_size)),
    Mistake("camera: 6 degrees of yaw", ("cameras", "images"), _cameras(_pose(_yawed), only_first=True), (LIDAR,)),
    Mistake("images: of two cameras swapped", ("images",), _images_swapped, (LIDAR, PAIR)),
    Mistake("images: mirrored", ("images",), _mirrored, (LIDAR,)),
    Mistake("images: of the next frame", ("images", "cameras"), _images_of_next, (LIDAR, MOVES)),
    Mistake("LiDAR: sensor frame for ego", ("lidar", "ground"), _lidar(_sensor_for_ego), (LIDAR,)),
    Mistake("LiDAR: a quarter turn", ("boxes", "lidar", "images"), _lidar(_quarter_turn), (LIDAR,)),
    Mistake("ground: not at z = 0", ("ground",), _lowered, (LIDAR,)),
    Mistake("poses: inverted", ("poses",), _poses_inverted, (MOVES,)),
    Mistake("time: three seconds missing", ("time",), _late, (MORE_FRAMES,)),
)


def has(recording: Recording) -> set[str]:
    """What a recording has that mistakes need."""
    frame = recording[0]
    found = set()
    if frame.lidar is not None:
        found.add(LIDAR)
    if frame.boxes_world is not None and len(frame.boxes_world) >= 4:
        found.add(BOXES)
    if len(recording) >= 4:
        found |= {MORE_FRAMES}
    if len(recording) > 1 and np.linalg.norm(recording[1].world_from_ego.translation - frame.world_from_ego.translation) > 0.5:
        found.add(MOVES)
    if len({_size(c) for c in frame.rig.values()}) < len(frame.rig):
        found.add(PAIR)
    return found
