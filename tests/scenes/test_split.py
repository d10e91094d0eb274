"""Which point of which sweep belongs to whom, and in which frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from coin3d.datasets.frame import Frame
from coin3d.datasets.nuscenes_format import NuScenesRecording
from coin3d.geometry import Boxes3D, Pose
from coin3d.scenes.split import MIN_RANGE_M, split_scene
from coin3d.scenes.tracks import build_tracks, instance_names, key_interval_ns
from small_world import MemoryLidar, ring_rig
from tiny_recording import EGO_FROM_LIDAR, car_world, world_from_ego

SECOND = 1_000_000_000


def box_frame(time_ns: int, points: np.ndarray, boxes: Boxes3D | None, *, lidar: bool = True, token: str = "") -> Frame:
    """A frame of points and boxes at an ego standing at the world origin; the sensor is 1.8 m up."""
    rig = ring_rig(1)
    images = {name: np.zeros((c.height_px, c.width_px, 3), dtype=np.uint8) for name, c in rig.items()}
    source = MemoryLidar(np.asarray(points, dtype=np.float64).reshape(-1, 3)) if lidar else None
    return Frame(token or f"t{time_ns}", time_ns, rig, images, boxes_world=boxes, lidar=source)


def one_box(x: float, *, yaw: float = 0.0, name: str = "car", **known: object) -> Boxes3D:
    return Boxes3D.create([[x, 0, 0.75]], [[4.0, 2.0, 1.5]], [yaw], ["car"], instance_ids=[name], **known)


def test_key_frames_of_a_recording_give_object_points_in_the_box_frame(tiny_recording: Path) -> None:
    recording = NuScenesRecording(tiny_recording)
    frames = [f for f in recording if f.scene == "street-0"]
    split = split_scene(frames)
    assert split.num_sweeps == 3
    car = split.objects["car0"]
    expected = np.stack([np.linspace(-1.5, 1.5, 7), np.full(7, 0.4), np.linspace(-0.5, 0.5, 7)], axis=-1)
    assert car.num_points == 21 and len(car.rays) == 42
    np.testing.assert_allclose(car.rays.points_m[:21], np.tile(expected, (3, 1)), atol=1e-5)
    np.testing.assert_allclose(car.rays.points_m[21:], np.tile(expected * [1, -1, 1], (3, 1)), atol=1e-5)
    sensors = np.stack([world_from_ego(k).apply(EGO_FROM_LIDAR.translation) - car_world(k) for k in range(3)])
    np.testing.assert_allclose(car.rays.origins_m[car.rays.origin_of[[0, 7, 14]]], sensors, atol=1e-6)
    np.testing.assert_allclose(car.rays.origins_m[car.rays.origin_of[[21, 28, 35]]], sensors * [1, -1, 1], atol=1e-6)
    assert split.objects["walker0"].num_points == 0


def test_sweeps_between_key_frames_are_read(tiny_recording: Path) -> None:
    recording = NuScenesRecording(tiny_recording)
    frames = [f for f in recording if f.scene == "street-0"]
    split = split_scene(frames, recording.sweeps)
    assert split.num_sweeps == 3 + sum(len(recording.sweeps(f)) for f in frames) > 3
    assert split.objects["car0"].num_points > 21


def test_background_keeps_clear_of_boxes_and_objects_of_the_ground() -> None:
    inside, rim, outside, floor = [10, 0, 0.75], [12.05, 0, 0.75], [12.15, 0, 0.75], [10, 0, 0.03]
    too_near, too_far = [MIN_RANGE_M - 1.5, 0, 1.8], [150, 0, 1]
    split = split_scene([box_frame(0, np.array([inside, rim, outside, floor, too_near, too_far]), one_box(10))])
    np.testing.assert_allclose(split.background.points_m, [outside])
    np.testing.assert_allclose(split.background.origins_m[split.background.origin_of], [[0, 0, 1.8]])
    np.testing.assert_allclose(split.objects["car"].rays.points_m[:1], [[0, 0, 0]])
    assert split.objects["car"].num_points == 1


def test_boxes_move_between_key_frames_along_the_shorter_arc() -> None:
    frames = [
        box_frame(0, np.zeros((0, 3)), one_box(10, yaw=np.deg2rad(170))),
        box_frame(SECOND // 2, np.zeros((0, 3)), one_box(14, yaw=np.deg2rad(-170))),
    ]
    track = build_tracks(frames)["car"]
    box = track.at(SECOND // 4, key_interval_ns(frames))
    assert box is not None and box.reliable
    np.testing.assert_allclose(box.world_from_box.translation, [12, 0, 0.75])
    assert abs(box.world_from_box.yaw_rad) == pytest.approx(np.pi)


def test_nobody_claims_points_long_before_or_after_it_was_annotated() -> None:
    empty = np.zeros((0, 3))
    times = [0, 1, 2, 3, 8, 9]
    there = [False, True, True, False, False, True]
    frames = [
        box_frame(t * SECOND // 2, empty, one_box(10 + t) if on else Boxes3D.empty())
        for t, on in zip(times, there, strict=True)
    ]
    track, interval = build_tracks(frames)["car"], key_interval_ns(frames)
    assert interval == SECOND // 2
    half = SECOND // 4
    going_on = track.at(0, interval)
    assert going_on is not None and not going_on.reliable  # it moves, so this is a guess
    np.testing.assert_allclose(going_on.world_from_box.translation[0], 10.0)
    assert track.at(-1, interval) is None
    assert track.at(5 * half, interval) is not None  # in the gap, within an interval of the last annotation before it
    assert track.at(10 * half, interval) is None
    assert track.at(20 * half, interval) is not None and track.at(20 * half + 1, interval) is None


def test_an_instance_seen_once_stands_or_goes_on_as_annotated() -> None:
    empty = np.zeros((0, 3))
    for velocity, reliable in ((0.0, True), (4.0, False)):
        frames = [box_frame(0, empty, one_box(10, velocity_mps=[[velocity, 0]]))]
        box = build_tracks(frames)["car"].at(SECOND // 4, key_interval_ns(frames))
        assert box is not None and box.reliable == reliable
        assert box.world_from_box.translation[0] == pytest.approx(10 + velocity / 4)


def test_a_guessed_pose_keeps_background_clean_but_gives_no_object_points() -> None:
    boxes = one_box(10, velocity_mps=[[4.0, 0]])
    frame = box_frame(0, np.array([[10.0, 0, 1]]), boxes)
    later = MemoryLidar(np.array([[11.0, 0, 1], [30.0, 0, 1]]))
    split = split_scene([frame], lambda _: [(SECOND // 4, later)])
    assert split.objects["car"].num_points == 1
    np.testing.assert_allclose(split.background.points_m, [[30, 0, 1]])


def test_boxes_without_instance_ids_are_instances_of_their_frame() -> None:
    points = np.array([[10.0, 0.5, 0.5]])
    frames = [box_frame(t, points, one_box(10, name=""), token=f"f{t}") for t in (0, SECOND // 2)]
    assert instance_names(frames[1]) == [f"f{SECOND // 2}/0"]
    split = split_scene(frames)
    assert list(split.objects) == ["f0/0", f"f{SECOND // 2}/0"]
    assert all(o.num_points >= 1 for o in split.objects.values())


def test_frames_without_lidar_or_labels_are_passed_over() -> None:
    frames = [
        box_frame(0, np.array([[10.0, 0, 1]]), one_box(10), lidar=False),
        box_frame(SECOND // 2, np.array([[10.0, 0, 1], [20.0, 0, 1]]), None),
    ]
    split = split_scene(frames)
    assert split.num_sweeps == 1
    # the car stands half a second before, so it claims its point still
    np.testing.assert_allclose(split.background.points_m, [[20, 0, 1]])
    assert split_scene([]).num_sweeps == 0


def test_contradictions_are_named() -> None:
    frames = [box_frame(SECOND, np.zeros((0, 3)), None), box_frame(0, np.zeros((0, 3)), None)]
    with pytest.raises(ValueError, match="not in time order"):
        split_scene(frames)
    twice = Boxes3D.concatenate([one_box(10), one_box(20)])
    with pytest.raises(ValueError, match="t0: instance 'car' is annotated twice"):
        split_scene([box_frame(0, np.zeros((0, 3)), twice)])


def test_poses_of_the_ego_carry_points_and_origins() -> None:
    frame = box_frame(0, np.array([[10.0, 0, 1]]), None)
    moved = Frame(frame.token, 0, frame.rig, frame.images, Pose.from_euler(np.pi / 2, 0, 0, [100, 50, 2]), None, frame.lidar)
    rays = split_scene([moved]).background
    np.testing.assert_allclose(rays.points_m, [[100, 60, 3]], atol=1e-9)
    np.testing.assert_allclose(rays.origins_m, [[100, 50, 3.8]], atol=1e-9)
