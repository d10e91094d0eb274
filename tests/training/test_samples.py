"""Training samples: functions of seed and number, with boxes, depth and cameras that tell the same story."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from coin3d.augmentation import BevAugmentation, FocalAugmentation, ImageAugmentation
from coin3d.datasets.classes import ClassMap
from coin3d.datasets.frame import Frame
from coin3d.detectors import Sample
from coin3d.detectors.inputs import lidar_depth
from coin3d.geometry import Boxes3D, GroundPlane, Pose, Rig
from coin3d.training.samples import AugmentOptions, TrainingSamples, visible_boxes
from small_world import SIZE_PX, MemoryRecording, frame, ring_rig

CARS = ClassMap("cars", {"car": "car"})
BOTH = ClassMap("both", {"car": "car", "pedestrian": "pedestrian"})
STILL = AugmentOptions(ImageAugmentation(0.0, 0.0), BevAugmentation(0.0, 1.0, 1.0, 0.0))


def samples(
    frames: list[Frame], augment: AugmentOptions | None = None, *, seed: int = 0, classes: ClassMap = BOTH, zoom: bool = False
) -> TrainingSamples:
    view_augmentation = FocalAugmentation() if zoom else None
    augment = AugmentOptions() if augment is None else augment
    return TrainingSamples([MemoryRecording(frames)], classes, SIZE_PX, augment, view_augmentation, seed, 1000)


def equal(a: Sample, b: Sample) -> bool:
    assert a.boxes is not None and b.boxes is not None and a.depth_m is not None and b.depth_m is not None
    return (
        np.array_equal(a.images, b.images)
        and all(np.array_equal(c.K, d.K) for c, d in zip(a.cameras, b.cameras, strict=True))
        and np.array_equal(a.bev_from_ego, b.bev_from_ego)
        and np.array_equal(a.depth_m, b.depth_m)
        and np.array_equal(a.boxes.centre_m, b.boxes.centre_m)
    )


def test_a_sample_is_a_function_of_seed_and_number() -> None:
    frames = [frame(i, ring_rig(3)) for i in range(3)]
    augment = AugmentOptions(cameras_per_sample=2)
    one, same, other = (samples(frames, augment, seed=seed, zoom=True) for seed in (5, 5, 6))
    assert len(one) == 1000
    drawn = [one[i] for i in (4, 0, 7)]  # in another order, and after others
    assert all(equal(same[i], s) for i, s in zip((4, 0, 7), drawn, strict=True))
    assert not equal(one[4], other[4])
    assert not equal(one[4], one[5])


def test_every_pass_sees_every_frame_once_in_another_order() -> None:
    frames = [frame(i, ring_rig(1)) for i in range(5)]
    drawn = samples(frames, STILL)
    first = [f.image("eye0") for f in frames]
    seen = [next(k for k in range(5) if np.array_equal(first[k], drawn[n].images[0])) for n in range(20)]
    passes = [seen[i : i + 5] for i in range(0, 20, 5)]
    assert all(sorted(p) == list(range(5)) for p in passes)
    assert len({tuple(p) for p in passes}) > 1


def test_a_frame_seen_again_is_augmented_anew() -> None:
    drawn = samples([frame(0, ring_rig(2))])
    assert not equal(drawn[0], drawn[1])


def test_recordings_are_mixed() -> None:
    first, second = [MemoryRecording([frame(i, ring_rig(n)) for i in range(2)]) for n in (2, 4)]
    mixed = TrainingSamples([first, second], BOTH, SIZE_PX, STILL, None, 0, 100)
    assert Counter(len(mixed[n].cameras) for n in range(8)) == {2: 4, 4: 4}


def test_without_augmentation_everything_is_as_recorded() -> None:
    f = frame(1, ring_rig(3))
    drawn = samples([f], STILL)[0]
    assert f.boxes is not None and f.lidar is not None and drawn.boxes is not None and drawn.depth_m is not None
    assert drawn.bev_from_ego.tolist() == np.eye(3).tolist()
    seen = f.boxes[np.any([c.sees(f.boxes.centre_m) for c in f.rig.values()], axis=0)]
    np.testing.assert_array_equal(drawn.boxes.centre_m, seen.centre_m)
    for i, (name, camera) in enumerate(f.rig.items()):
        np.testing.assert_array_equal(drawn.images[i], f.image(name))
        np.testing.assert_array_equal(drawn.depth_m[i], lidar_depth(f.lidar.load().points_ego, camera))


def test_depth_and_boxes_follow_the_augmentation() -> None:
    """LiDAR points inside a box, seen through the augmented camera and turned by the augmented plane, are in the box."""
    f = frame(2, ring_rig(4))
    assert f.lidar is not None
    points = f.lidar.load().points_ego
    for n in range(5):
        drawn = samples([f], zoom=True)[n]
        assert drawn.boxes is not None and drawn.depth_m is not None and len(drawn.boxes) > 0
        for i, camera in enumerate(drawn.cameras):
            np.testing.assert_array_equal(drawn.depth_m[i], lidar_depth(points, camera))
        assert f.boxes is not None
        original = f.boxes.contains(points).sum()
        turned = drawn.boxes.contains(points @ drawn.bev_from_ego.T).sum(1)
        assert original > 0 and (turned >= 40).all()


def test_boxes_the_chosen_cameras_do_not_see_are_dropped() -> None:
    f = frame(3, ring_rig(4))
    assert f.boxes is not None
    drawn = samples([f], replace(STILL, cameras_per_sample=1))
    counts = set()
    for n in range(12):
        (camera,) = drawn[n].cameras
        boxes = drawn[n].boxes
        assert boxes is not None
        assert camera.sees(boxes.centre_m).all() and len(boxes) == camera.sees(f.boxes.centre_m).sum()
        counts.add(len(boxes))
    assert len(counts) > 1 and max(counts) < len(f.boxes)


def test_boxes_without_lidar_points_are_dropped_where_points_were_counted() -> None:
    (camera,) = ring_rig(1).values()
    boxes = Boxes3D.create([(10, 0, 1)] * 3, [(4, 2, 1.5)] * 3, [0, 0, 0], ["car"] * 3, num_lidar_points=[0, 3, -1])
    assert visible_boxes(boxes, [camera]).num_lidar_points.tolist() == [3, -1]
    assert len(visible_boxes(Boxes3D.empty(), [camera])) == 0


def test_cameras_are_chosen_fairly_and_stay_in_order() -> None:
    drawn = samples([frame(0, ring_rig(4))], replace(STILL, cameras_per_sample=2))
    yaws = [[round(c.yaw_rad % (2 * np.pi), 3) for c in drawn[n].cameras] for n in range(60)]
    assert all(len(y) == 2 and y == sorted(y) for y in yaws)
    assert min(Counter(y for pair in yaws for y in pair).values()) > 15
    assert len(samples([frame(0, ring_rig(2))], replace(STILL, cameras_per_sample=5))[0].cameras) == 2


def test_only_the_classes_of_the_map_are_learned() -> None:
    f = frame(0, ring_rig(4))
    drawn = samples([f], STILL, classes=CARS)[0]
    assert drawn.boxes is not None and set(drawn.boxes.labels) == {"car"}


def test_frames_that_cannot_be_trained_on_are_named() -> None:
    f = frame(9, ring_rig(2))
    with pytest.raises(ValueError, match="frame9 has no annotations"):
        samples([f.with_boxes_world(None)])[0]
    with pytest.raises(ValueError, match="frame9 has no LiDAR"):
        samples([replace(f, lidar=None)])[0]
    with pytest.raises(ValueError, match="no frames"):
        samples([])
    with pytest.raises(ValueError, match="cameras_per_sample"):
        AugmentOptions(cameras_per_sample=-1)


def test_a_frame_without_boxes_is_a_sample_too() -> None:
    drawn = samples([frame(0, ring_rig(2)).with_boxes_world(Boxes3D.empty())])[0]
    assert drawn.boxes is not None and len(drawn.boxes) == 0


def test_frames_before_are_drawn_like_the_latest() -> None:
    """Same cameras, same zoom, same turn of the plane; the motion is that of the ego poses."""
    first, last = frame(0, ring_rig(4)), frame(1, ring_rig(4))
    moved = Pose.from_euler(0.2, 0.0, 0.0, (3.0, 1.0, 0.0))
    last = replace(last, previous=first.token, world_from_ego=moved)
    augment = AugmentOptions(cameras_per_sample=2)
    alone = TrainingSamples([MemoryRecording([first, last])], BOTH, SIZE_PX, augment, FocalAugmentation(), 3, 100)
    both = TrainingSamples([MemoryRecording([first, last])], BOTH, SIZE_PX, augment, FocalAugmentation(), 3, 100, frames=3)
    seen = set()
    for n in range(6):
        drawn = both[n]
        assert equal(drawn, alone[n])  # looking back changes nothing of the latest frame
        before = drawn.previous
        assert before is not None and before.previous is not None and before.previous.previous is None
        assert before.boxes is None and before.key_from_ego is not None
        assert all(np.array_equal(a.K, b.K) for a, b in zip(drawn.cameras, before.cameras, strict=True))
        poses = [(a.ego_from_cam.matrix, b.ego_from_cam.matrix) for a, b in zip(drawn.cameras, before.cameras, strict=True)]
        assert all(np.array_equal(a, b) for a, b in poses)
        assert np.array_equal(before.bev_from_ego, drawn.bev_from_ego)
        still = np.array_equal(before.images, drawn.images)
        expected = np.eye(4) if still else moved.inverse().matrix  # where the scene begins, the first frame stands in
        np.testing.assert_allclose(before.key_from_ego, expected, atol=1e-12)
        np.testing.assert_array_equal(before.previous.images, before.images)
        seen.add(still)
    assert seen == {True, False}


def test_a_half_turn_tells_the_same_story_in_another_frame() -> None:
    """Depth maps stay, what was ahead is behind, and points stay in their boxes and boxes in their images."""
    ahead = Rig({name: camera for name, camera in ring_rig(8).items() if name in ("eye0", "eye1", "eye7")})
    f = replace(frame(2, tilted(ahead)), previous="frame1")
    before = replace(frame(1, ahead), world_from_ego=Pose.from_euler(0.1, 0, 0, (-4.0, 0, 0)))
    recording = MemoryRecording([before, f])
    plain, turned = (
        TrainingSamples([recording], BOTH, SIZE_PX, replace(STILL, half_turn_probability=p), None, 0, 9, frames=2)
        for p in (0.0, 1.0)
    )
    a, b = (next(d for d in (s[0], s[1]) if np.array_equal(d.images[0], f.image("eye0"))) for s in (plain, turned))
    assert a.boxes is not None and b.boxes is not None and a.depth_m is not None and b.depth_m is not None
    np.testing.assert_allclose(b.boxes.centre_m, a.boxes.centre_m * (-1, -1, 1), atol=1e-12)
    np.testing.assert_allclose(np.cos(b.boxes.yaw_rad - a.boxes.yaw_rad), -1, atol=1e-12)
    np.testing.assert_allclose(b.depth_m, a.depth_m, atol=1e-9)
    np.testing.assert_allclose(b.ground.normal, a.ground.normal * (-1, -1, 1))
    for one, other in zip(a.cameras, b.cameras, strict=True):
        np.testing.assert_allclose(one.project(a.boxes.centre_m)[0], other.project(b.boxes.centre_m)[0])
    assert a.previous is not None and b.previous is not None
    # a still point, seen by the camera of the frame before, is the same pixel however the frames are told
    point = np.array([[6.0, 1.0, 1.0]])
    for drawn, place in ((a, point), (b, point * (-1, -1, 1))):
        assert drawn.previous is not None and drawn.previous.key_from_ego is not None
        earlier = Pose.from_matrix(np.linalg.inv(drawn.previous.key_from_ego)).apply(place)
        np.testing.assert_allclose(
            drawn.previous.cameras[0].project(earlier)[0],
            before.rig["eye0"].project((before.world_from_ego.inverse() @ f.world_from_ego).apply(point))[0],
        )


def test_rigs_that_see_behind_are_never_turned() -> None:
    frames = [frame(i, ring_rig(4)) for i in range(3)]
    augment = AugmentOptions(cameras_per_sample=2)
    plain, same = samples(frames, augment), samples(frames, replace(augment, half_turn_probability=1.0))
    assert all(equal(plain[n], same[n]) for n in range(6))


def tilted(rig: Rig) -> Rig:
    return Rig(dict(rig.items()), ground=GroundPlane(np.array([0.1, 0.05, 1.0]), 0.1))
