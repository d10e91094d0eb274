"""The one contract every recording format is read into, and everything downstream reads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, UInt8

from coin3d.datasets.image_source import ImageSource, load_image, reduction_to
from coin3d.geometry import Boxes3D, Pose, Rig


@dataclass(frozen=True, eq=False)
class LidarScan:
    """One LiDAR sweep in the ego frame of its frame.

    Args:
        points_ego: (N, 3) metres.
        intensity: (N,) as recorded.
        origin_ego: (3,) position of the sensor, from which the rays started.
    """

    points_ego: Float[np.ndarray, "n 3"]
    intensity: Float[np.ndarray, "n"]
    origin_ego: Float[np.ndarray, "3"]


@runtime_checkable
class LidarSource(Protocol):
    """Anything that can load a sweep when it is asked for."""

    def load(self) -> LidarScan:
        """Read the sweep; raises ValueError for a missing or truncated file."""
        ...


@dataclass(frozen=True, eq=False)
class Frame:
    """One annotated instant of a recording. Images and LiDAR are read when asked for.

    All geometry is in the ego frame at the reference time (the key-frame LiDAR's), x forward, y left, z up.

    Args:
        token: unique name within the recording.
        timestamp_ns: reference time.
        rig: the cameras of this instant; poses include the ego motion up to each camera's own trigger time
            (``time_sync = pose``), so static points project exactly.
        images: camera name -> file or pixels, same names and order as ``rig``.
        world_from_ego: ego pose at the reference time.
        boxes_world: annotations in the world frame, ``None`` where the recording has no labels. Labels are the data
            set's own category names; ``datasets.classes`` maps them.
        lidar: the sweep at the reference time, if recorded.
        scene: name of the sequence.
        previous: token of the frame before in the same scene, or "".
        next: token of the frame after in the same scene, or "".
        own_vehicle: camera name -> mask of the pixels that show the vehicle itself, not black there; for any of the cameras.
    """

    token: str
    timestamp_ns: int
    rig: Rig
    images: Mapping[str, ImageSource]
    world_from_ego: Pose = field(default_factory=Pose.identity)
    boxes_world: Boxes3D | None = None
    lidar: LidarSource | None = None
    scene: str = ""
    previous: str = ""
    next: str = ""
    own_vehicle: Mapping[str, ImageSource] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if list(self.images) != list(self.rig):
            raise ValueError(f"frame {self.token}: images of {list(self.images)} but a rig with {list(self.rig)}")

    @cached_property
    def boxes(self) -> Boxes3D | None:
        """Annotations in the ego frame."""
        return None if self.boxes_world is None else self.boxes_world.transformed(self.world_from_ego.inverse())

    def image(self, camera: str, at_least_px: tuple[int, int] | None = None) -> UInt8[np.ndarray, "h w 3"]:
        """The RGB image of a camera.

        Args:
            camera: its name.
            at_least_px: (width, height) that will do. The image then comes 1, 2, 4 or 8 times smaller than recorded, which is
                cheaper to decode; it shows the same as the whole one, from edge to edge.

        Raises:
            ValueError: the file is missing or truncated, or its size contradicts the rig.
        """
        size_px = (self.rig[camera].width_px, self.rig[camera].height_px)
        reduction = 1 if at_least_px is None else reduction_to(size_px, at_least_px)
        return self._pixels(camera, self.images[camera], "image", reduction)

    def own_vehicle_mask(self, camera: str) -> Bool[np.ndarray, "h w"]:
        """Where a camera sees the vehicle that carries it; nowhere if nobody says.

        Raises:
            ValueError: the mask is damaged, or its size contradicts the rig.
        """
        if camera not in self.own_vehicle:
            return np.zeros((self.rig[camera].height_px, self.rig[camera].width_px), dtype=bool)
        mask = self._pixels(camera, self.own_vehicle[camera], "mask of the own vehicle")
        return np.asarray(mask.any(-1) if mask.ndim == 3 else mask != 0)

    def _pixels(self, camera: str, source: ImageSource, what: str, reduction: int = 1) -> np.ndarray:
        pixels = load_image(source, reduction)
        height, width = self.rig[camera].height_px, self.rig[camera].width_px
        if pixels.shape[:2] == (height // reduction, width // reduction):
            return pixels
        if reduction > 1:  # a reduced one does not tell its size to the pixel
            pixels = load_image(source)
        raise ValueError(
            f"frame {self.token}, {camera}: the {what} {'' if isinstance(source, np.ndarray) else source} is "
            f"{pixels.shape[1]} x {pixels.shape[0]} pixels but the rig says {width} x {height}; "
            "correct 'size' (and K) in the calibration"
        )

    def with_boxes_world(self, boxes_world: Boxes3D | None) -> Frame:
        """The same frame with other annotations."""
        return replace(self, boxes_world=boxes_world)


@runtime_checkable
class Recording(Protocol):
    """A sequence of frames: three methods, whatever the format on disk."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int) -> Frame: ...

    def __iter__(self) -> Iterator[Frame]: ...
