"""Step 1.1, first half: split LiDAR sweeps by the 4D annotations into background and instances (paper sec. 4.2)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from coin3d.datasets.frame import Frame, LidarSource
from coin3d.scenes.ray_cloud import RayCloud
from coin3d.scenes.tracks import BoxAt, Track, build_tracks, key_interval_ns

SweepsOf = Callable[[Frame], Sequence[tuple[int, LidarSource]]]
"""The sweeps after a key frame and before the next as (time in ns, source), in the ego frame of the key frame."""

MIN_RANGE_M, MAX_RANGE_M = 3.0, 100.0
BACKGROUND_MARGIN_M = 0.1
"""Background keeps this far from every box, on all sides."""
RAISED_BOTTOM_M = 0.05
"""Objects start this far above the bottom of their box, where the ground is no longer."""


@dataclass(frozen=True, eq=False)
class ObjectRays:
    """What was seen of one instance.

    Args:
        track: its annotations.
        rays: in the box frame (origin at the box centre, x forward, z up), the mirrored copy behind the seen half.
        num_points: points seen, the mirrored copy not counted.
    """

    track: Track
    rays: RayCloud
    num_points: int


@dataclass(frozen=True, eq=False)
class SplitScene:
    """A scene's rays: the background in the world frame, each instance in its box frame.

    Args:
        background: outside of all boxes.
        objects: by instance name; instances without points are there with none.
        num_sweeps: sweeps that were read, key frames included.
    """

    background: RayCloud
    objects: dict[str, ObjectRays]
    num_sweeps: int


def no_sweeps(frame: Frame) -> Sequence[tuple[int, LidarSource]]:
    """For recordings of key frames only."""
    return []


def split_scene(frames: Sequence[Frame], sweeps_of: SweepsOf = no_sweeps) -> SplitScene:
    """Split all sweeps of a scene. Frames without LiDAR are passed over.

    Args:
        frames: key frames of one scene in time order.
        sweeps_of: the sweeps between them, for example ``recording.sweeps``.

    Raises:
        ValueError: frames out of order, an instance twice in a frame, or a sweep that cannot be read.
    """
    tracks, interval_ns = build_tracks(frames), key_interval_ns(frames)
    background: list[RayCloud] = []
    seen: dict[str, list[RayCloud]] = {name: [] for name in tracks}
    for time_ns, rays in _sweeps_world(frames, sweeps_of):
        outside = np.ones(len(rays), dtype=bool)
        for name, track in tracks.items():
            box = track.at(time_ns, interval_ns)
            if box is None:
                continue
            near = np.flatnonzero(_near(rays.points_m, box))
            if not len(near):
                continue
            local = rays[near].transformed(box.world_from_box.inverse())
            half = box.size_m / 2
            outside[near[(np.abs(local.points_m) <= half + BACKGROUND_MARGIN_M).all(1)]] = False
            if box.reliable:
                inside = (np.abs(local.points_m) <= half).all(1) & (local.points_m[:, 2] >= RAISED_BOTTOM_M - half[2])
                if inside.any():
                    seen[name].append(local[inside])
        background.append(rays[outside])
    return SplitScene(
        RayCloud.concatenate(background), {name: _object(tracks[name], parts) for name, parts in seen.items()}, len(background)
    )


def _sweeps_world(frames: Sequence[Frame], sweeps_of: SweepsOf) -> Iterator[tuple[int, RayCloud]]:
    """All sweeps with their times, in the world frame, without returns that are too near or too far."""
    for frame in frames:
        sources = [] if frame.lidar is None else [(frame.timestamp_ns, frame.lidar)]
        for time_ns, source in [*sources, *sweeps_of(frame)]:
            scan = source.load()
            rays = RayCloud.from_origin(scan.points_ego, scan.origin_ego)
            range_m = rays.range_m()
            kept = (range_m >= MIN_RANGE_M) & (range_m <= MAX_RANGE_M)
            yield time_ns, rays[kept].transformed(frame.world_from_ego)


def _near(points_m: Float[np.ndarray, "n 3"], box: BoxAt) -> Bool[np.ndarray, "n"]:
    """Points in the upright square around a box: cheap, and few are left for the exact test."""
    reach = float(np.hypot(box.size_m[0], box.size_m[1])) / 2 + 2 * BACKGROUND_MARGIN_M
    x, y, _ = box.world_from_box.translation
    return np.asarray((np.abs(points_m[:, 0] - x) < reach) & (np.abs(points_m[:, 1] - y) < reach))


def _object(track: Track, parts: list[RayCloud]) -> ObjectRays:
    rays = RayCloud.concatenate(parts)
    return ObjectRays(track, RayCloud.concatenate([rays, rays.mirrored()]), len(rays))
