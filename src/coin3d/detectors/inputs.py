"""From frames to batches: fit images to the network, project LiDAR, stack."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, UInt8

from coin3d.augmentation import RecordedImage, View
from coin3d.datasets.frame import Frame
from coin3d.detectors.batch import Batch, normalise_image
from coin3d.geometry import Boxes3D, Camera, GroundPlane, fit_width
from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.geometry.depth_image import nearest_depth


@dataclass(frozen=True, eq=False)
class Sample:
    """One frame as network input.

    Args:
        images: (N, H, W, 3) RGB bytes.
        cameras: the N cameras of those images.
        ground: ground plane of the rig.
        bev_from_ego: (3, 3) BEV augmentation.
        depth_m: (N, H, W) sparse LiDAR depth, or None.
        boxes: ground truth in the augmented BEV frame, or None.
        key_from_ego: of a frame before another: from its ego frame to the latest frame's.
        previous: the frame before.
    """

    images: UInt8[np.ndarray, "n h w 3"]
    cameras: tuple[Camera, ...]
    ground: GroundPlane
    bev_from_ego: Float[np.ndarray, "3 3"]
    depth_m: Float[np.ndarray, "n h w"] | None = None
    boxes: Boxes3D | None = None
    key_from_ego: Float[np.ndarray, "4 4"] | None = None
    previous: Sample | None = None


def plain_views(frame: Frame, width_px: int, height_px: int) -> list[View]:
    """The frame's images with the paper's image rule and no augmentation, in the order of the rig."""
    return [
        View(RecordedImage(frame, name), camera, fit_width(camera, width_px, height_px)) for name, camera in frame.rig.items()
    ]


def frame_sample(frame: Frame, width_px: int, height_px: int, earlier: Sequence[Frame] = ()) -> Sample:
    """A frame as input for detection, with the frames before it, latest first."""
    views = plain_views(frame, width_px, height_px)
    images = np.stack([v.network_image() for v in views])
    sample = Sample(images, tuple(v.network_camera() for v in views), frame.rig.ground, np.eye(3))
    return with_earlier(sample, frame, earlier, [frame_sample(before, width_px, height_px) for before in earlier])


def with_earlier(sample: Sample, frame: Frame, earlier: Sequence[Frame], samples: Sequence[Sample]) -> Sample:
    """A sample and those of the frames before it, chained; the motion between them is that of the ego poses.

    Args:
        sample: of ``frame``.
        frame: the latest.
        earlier: the frames before it, latest first.
        samples: of those.
    """
    previous: Sample | None = None
    for before, drawn in zip(reversed(earlier), reversed(samples), strict=True):
        motion = (frame.world_from_ego.inverse() @ before.world_from_ego).matrix
        previous = replace(drawn, key_from_ego=motion, previous=previous)
    return replace(sample, previous=previous)


def collate(samples: Sequence[Sample]) -> Batch:
    """Stack samples; rigs may have different numbers of cameras. Depth, boxes and frames before are kept if all have them.

    Raises:
        ValueError: no samples, or images of different sizes.
    """
    grounds = [s.ground for s in samples for _ in s.cameras]
    cameras = CameraTensors.from_cameras([c for s in samples for c in s.cameras], grounds)
    depths = [s.depth_m for s in samples if s.depth_m is not None]
    boxes = [s.boxes for s in samples if s.boxes is not None]
    motions = [s.key_from_ego for s in samples for _ in s.cameras if s.key_from_ego is not None]
    previous = [s.previous for s in samples if s.previous is not None]
    return Batch(
        torch.stack([normalise_image(image) for s in samples for image in s.images]),
        cameras,
        torch.tensor([i for i, s in enumerate(samples) for _ in s.cameras]),
        torch.from_numpy(np.stack([s.bev_from_ego for s in samples])).float(),
        torch.from_numpy(np.concatenate(depths)) if len(depths) == len(samples) else None,
        tuple(boxes) if len(boxes) == len(samples) else (),
        torch.from_numpy(np.stack(motions)).float() if len(motions) == len(grounds) else None,
        collate(previous) if previous and len(previous) == len(samples) else None,
    )


def lidar_depth(points_ego: Float[np.ndarray, "n 3"], camera: Camera) -> Float[np.ndarray, "h w"]:
    """Nearest LiDAR depth in each pixel of a camera, metres along the optical axis, 0 where no point falls."""
    nearest = nearest_depth(points_ego, camera)
    nearest[np.isinf(nearest)] = 0
    return nearest
