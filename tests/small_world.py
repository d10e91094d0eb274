"""A world small enough for unit tests: rigs of any number of cameras, frames held in memory, a detector of a few cells."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from coin3d.datasets.frame import Frame, LidarScan
from coin3d.detectors import Batch, BEVDepth, BEVDepthConfig, Sample, collate
from coin3d.detectors.center_decode import DecodeOptions
from coin3d.detectors.inputs import lidar_depth
from coin3d.detectors.lift_splat import BevGrid, DepthBins
from coin3d.geometry import Boxes3D, Camera, Rig, camera_pose, fit_width
from coin3d.methods import METHODS

torch.set_num_threads(1)  # networks of a few cells only wait for each other on more

CLASSES = ("car", "pedestrian")
SIZE_PX = (96, 64)
CONFIG = BEVDepthConfig(
    image_width_px=SIZE_PX[0],
    image_height_px=SIZE_PX[1],
    backbone="resnet18",
    strides=(8, 16),
    neck_channels=16,
    depth_channels=16,
    depth_blocks=1,
    aspp_channels=8,
    context_channels=16,
    bins=DepthBins(1.0, 25.0, 2.0),
    grid=BevGrid(half_extent_m=25.6, cell_m=1.6),
    bev_stages=(16, 16, 16),
    bev_channels=16,
    head_channels=16,
    min_radius_cells=1,
    decode=DecodeOptions(min_score=0.0, max_boxes=50),
)


def ring_rig(cameras: int, *, size_px: tuple[int, int] = SIZE_PX, focal_px: float = 60.0, height_m: float = 1.6) -> Rig:
    """Cameras looking out evenly, the first one forward."""
    width, height = size_px
    K = np.array([[focal_px, 0, width / 2 + 0.7], [0, focal_px, height / 2 - 1.3], [0, 0, 1]])
    yaws = 2 * np.pi * np.arange(cameras) / cameras
    poses = [camera_pose((np.cos(a), 0.5 * np.sin(a), height_m), float(a)) for a in yaws]
    return Rig({f"eye{i}": Camera(K, width, height, pose) for i, pose in enumerate(poses)})


def scattered_boxes(seed: int, count: int = 6, reach_m: float = 20.0) -> Boxes3D:
    """Cars and pedestrians standing around the ego vehicle, with names a class map knows."""
    rng = np.random.default_rng(seed)
    distance, bearing = rng.uniform(5, reach_m, count), rng.uniform(-np.pi, np.pi, count)
    size = rng.uniform((3.5, 1.6, 1.4), (4.8, 2.0, 1.9), (count, 3))
    centre = np.column_stack([distance * np.cos(bearing), distance * np.sin(bearing), size[:, 2] / 2])
    labels = np.where(rng.random(count) < 0.7, "car", "pedestrian")
    return Boxes3D.create(centre, size, rng.uniform(-np.pi, np.pi, count), labels)


@dataclass(frozen=True)
class MemoryLidar:
    """A sweep that is already in memory."""

    points_ego: np.ndarray

    def load(self) -> LidarScan:
        return LidarScan(self.points_ego, np.zeros(len(self.points_ego)), np.array([0.0, 0.0, 1.8]))


def frame(seed: int, rig: Rig) -> Frame:
    """Noise with a bright patch where a box is seen; LiDAR on the ground and in the boxes."""
    rng = np.random.default_rng(seed)
    boxes = scattered_boxes(seed)
    images = {}
    for name, camera in rig.items():
        image = rng.integers(0, 90, (camera.height_px, camera.width_px, 3), dtype=np.uint8)
        pixels, _ = camera.project(boxes.centre_m[camera.sees(boxes.centre_m)])
        for u, v in pixels.astype(int):
            image[max(0, v - 4) : v + 5, max(0, u - 6) : u + 7] = 230
        images[name] = image
    ground = np.column_stack([rng.uniform(-25, 25, (1500, 2)), np.zeros(1500)])
    inside = (boxes.centre_m[:, None] + rng.uniform(-0.5, 0.5, (len(boxes), 40, 3))).reshape(-1, 3)
    return Frame(f"frame{seed}", seed, rig, images, boxes_world=boxes, lidar=MemoryLidar(np.concatenate([ground, inside])))


class MemoryRecording:
    """Frames in a list."""

    def __init__(self, frames: Sequence[Frame]) -> None:
        self.frames = list(frames)

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> Frame:
        return self.frames[index]

    def __iter__(self) -> Iterator[Frame]:
        return iter(self.frames)


def sample(seed: int, rig: Rig, *, bev_from_ego: np.ndarray | None = None) -> Sample:
    """A training sample without augmentation."""
    f = frame(seed, rig)
    cameras = [fit_width(c, *SIZE_PX).camera(c) for c in rig.values()]
    images = np.stack([fit_width(c, *SIZE_PX).image(f.image(name)) for name, c in rig.items()])
    assert f.lidar is not None
    points = f.lidar.load().points_ego
    depth_m = np.stack([lidar_depth(points, c) for c in cameras])
    bev = np.eye(3) if bev_from_ego is None else bev_from_ego
    return Sample(images, tuple(cameras), rig.ground, bev, depth_m, f.boxes)


def batch(*samples: Sample) -> Batch:
    return collate(samples)


def detector(method: str = "none", options: object = None, *, config: BEVDepthConfig = CONFIG, seed: int = 0) -> BEVDepth:
    """A fresh detector whose weights are a function of the seed."""
    kind, make = METHODS[method]
    torch.manual_seed(seed)
    return BEVDepth(config, CLASSES, make(kind() if options is None else options))


def settled(model: BEVDepth, on: Batch) -> BEVDepth:
    """The model in evaluation mode with batch norms that fit the data and open residuals: outputs vary as after training."""
    for module in model.modules():
        if isinstance(module, torch.nn.BatchNorm1d | torch.nn.BatchNorm2d):
            module.momentum = 1.0
            torch.nn.init.constant_(module.weight, 1.0)
    with torch.no_grad():
        model.train()(on)
    return model.eval()
