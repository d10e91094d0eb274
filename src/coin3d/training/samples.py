"""Training samples, each a function of the seed and its number alone: any of them can be drawn again."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch.utils.data
from jaxtyping import Float

from coin3d.augmentation import (
    BevAugmentation,
    FrameAugmentation,
    ImageAugmentation,
    RecordedImage,
    View,
    ViewAugmentation,
    transform_boxes,
)
from coin3d.datasets.classes import ClassMap
from coin3d.datasets.frame import Frame, Recording
from coin3d.datasets.frames_before import FramesBefore
from coin3d.detectors.inputs import Sample, lidar_depth, with_earlier
from coin3d.geometry import Boxes3D, Camera, GroundPlane, Pose, Rig, fit_width

BEHIND_M = np.array([-50.0, 0.0, 1.0])
"""A rig that does not see this point (ego frame) does not see behind."""
HALF_TURN = Pose.from_euler(np.pi, 0.0, 0.0, np.zeros(3))


@dataclass(frozen=True)
class AugmentOptions:
    """Augmentation that every method shares.

    Args:
        image: mirrors and turns of images.
        bev: turns, scales and mirrors of the ground plane.
        cameras_per_sample: train on this many randomly chosen cameras of each frame; 0 means all.
        half_turn_probability: chance that a sample of a rig that does not see behind is told in an ego frame that is turned by
            180 degrees, cameras, points, boxes and all, and so teaches what it is to look back.
        keep_unseen_boxes: also ask for boxes that no camera of the sample sees, as the released code does.
    """

    image: ImageAugmentation = field(default_factory=ImageAugmentation)
    bev: BevAugmentation = field(default_factory=BevAugmentation)
    cameras_per_sample: int = 0
    half_turn_probability: float = 0.0
    keep_unseen_boxes: bool = False

    def __post_init__(self) -> None:
        if self.cameras_per_sample < 0:
            raise ValueError(f"cameras_per_sample is 0 (all) or a count, got {self.cameras_per_sample}")
        if not 0 <= self.half_turn_probability <= 1:
            raise ValueError(f"half_turn_probability lies in [0, 1], got {self.half_turn_probability}")


class TrainingSamples(torch.utils.data.Dataset[Sample]):
    """Endless, shuffled, augmented samples of a recording.

    Sample n is drawn from the frame at place n of an endless sequence of shuffled passes, with a random generator seeded
    by (seed, n): a resumed run sees exactly what an uninterrupted one would have seen.

    Args:
        recordings: where frames come from; several are mixed frame by frame.
        class_map: which classes are learned.
        size_px: (width, height) of the network input.
        augment: generic augmentation.
        view_augmentation: the method's own augmentation of a raw view.
        seed: of everything random.
        count: how many samples there are.
        frame_augmentation: the method's own way to make all views of a sample.
        frames: 2 or more: samples bring the frames before along, seen by the same cameras and augmented alike.
    """

    def __init__(
        self,
        recordings: Sequence[Recording],
        class_map: ClassMap,
        size_px: tuple[int, int],
        augment: AugmentOptions,
        view_augmentation: ViewAugmentation | None,
        seed: int,
        count: int,
        frame_augmentation: FrameAugmentation | None = None,
        frames: int = 1,
    ) -> None:
        self.recordings, self.class_map, self.size_px = list(recordings), class_map, size_px
        self.augment, self.view_augmentation, self.seed, self.count = augment, view_augmentation, seed, count
        self.frame_augmentation, self.frames = frame_augmentation, frames
        self._before = [FramesBefore(recording) for recording in self.recordings]
        self.places = [(r, i) for r, recording in enumerate(self.recordings) for i in range(len(recording))]
        if not self.places:
            raise ValueError("there are no frames to train on")

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, number: int) -> Sample:
        epoch, place = divmod(number, len(self.places))
        order = np.random.default_rng([self.seed, epoch]).permutation(len(self.places))
        recording, index = self.places[order[place]]
        rng = np.random.default_rng([self.seed, epoch, number])
        frame = self.recordings[recording][index]
        return self.draw(frame, rng, self._before[recording](frame, self.frames - 1, index))

    def draw(self, frame: Frame, rng: np.random.Generator, earlier: Sequence[Frame] = ()) -> Sample:
        """One augmented sample of a frame, with the frames before it, latest first."""
        if frame.boxes is None:
            raise ValueError(f"frame {frame.token} has no annotations; training needs them")
        if frame.lidar is None:
            raise ValueError(f"frame {frame.token} has no LiDAR; training needs it for depth supervision")
        # every frame of a sample is drawn with the same numbers: same cameras, same augmentation, same novel rig
        again = [copy.deepcopy(rng) for _ in earlier]
        views = self._views(frame, rng)
        bev_from_ego = self.augment.bev.draw(rng)
        turn = self._turn(frame.rig, rng)
        cameras = _turned_cameras(views, turn)
        points_ego = turn.apply(frame.lidar.load().points_ego)
        boxes = self.class_map.apply(frame.boxes).transformed(turn)
        hit = boxes[boxes.num_lidar_points != 0]
        sample = Sample(
            np.stack([v.network_image() for v in views]),
            tuple(cameras),
            _turned_ground(frame.rig.ground, turn),
            bev_from_ego,
            np.stack([lidar_depth(points_ego, camera) for camera in cameras]),
            transform_boxes(hit if self.augment.keep_unseen_boxes else visible_boxes(hit, cameras), bev_from_ego),
        )
        before = [self._unlabelled(f, bev_from_ego, turn, same) for f, same in zip(earlier, again, strict=True)]
        return with_earlier(sample, _turned_frame(frame, turn), [_turned_frame(f, turn) for f in earlier], before)

    def _turn(self, rig: Rig, rng: np.random.Generator) -> Pose:
        sees_behind = bool(rig.sees(BEHIND_M))
        return Pose.identity() if sees_behind or rng.random() >= self.augment.half_turn_probability else HALF_TURN

    def _unlabelled(self, frame: Frame, bev_from_ego: Float[np.ndarray, "3 3"], turn: Pose, rng: np.random.Generator) -> Sample:
        views = self._views(frame, rng)
        images = np.stack([v.network_image() for v in views])
        return Sample(images, tuple(_turned_cameras(views, turn)), _turned_ground(frame.rig.ground, turn), bev_from_ego)

    def _choose(self, frame: Frame, rng: np.random.Generator) -> list[str]:
        names = list(frame.rig)
        count = self.augment.cameras_per_sample
        if count == 0 or count >= len(names):
            return names
        return [names[i] for i in sorted(rng.choice(len(names), count, replace=False))]

    def _views(self, frame: Frame, rng: np.random.Generator) -> list[View]:
        names = self._choose(frame, rng)
        if self.frame_augmentation is not None:
            made = self.frame_augmentation(frame, names, self.size_px, rng)
            if made is not None:
                return [self.augment.image(view, rng) for view in made]
        return [self._raw_view(frame, name, rng) for name in names]

    def _raw_view(self, frame: Frame, name: str, rng: np.random.Generator) -> View:
        camera = frame.rig[name]
        view = View(RecordedImage(frame, name), camera, fit_width(camera, *self.size_px))
        if self.view_augmentation is not None:
            view = self.view_augmentation(view, rng)
        return self.augment.image(view, rng)


def _turned_cameras(views: Sequence[View], turn: Pose) -> list[Camera]:
    return [camera.moved(turn @ camera.ego_from_cam) for camera in (v.network_camera() for v in views)]


def _turned_ground(ground: GroundPlane, turn: Pose) -> GroundPlane:
    return GroundPlane(turn.rotate(ground.normal), ground.offset_m)  # the ego origin stays where it is


def _turned_frame(frame: Frame, turn: Pose) -> Frame:
    return replace(frame, world_from_ego=frame.world_from_ego @ turn.inverse())


def visible_boxes(boxes: Boxes3D, cameras: Sequence[Camera]) -> Boxes3D:
    """Boxes a detector can be asked for: the centre falls into an image, and LiDAR hit it where hits were counted."""
    seen = np.zeros(len(boxes), dtype=bool)
    for camera in cameras:
        seen |= camera.sees(boxes.centre_m)
    return boxes[seen & (boxes.num_lidar_points != 0)]
