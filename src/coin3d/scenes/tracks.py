"""Where each annotated instance is between key frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from coin3d.datasets.frame import Frame
from coin3d.geometry import Pose, wrap_angle

DEFAULT_KEY_INTERVAL_NS = 500_000_000
# slower than this, the pose beyond the annotated span is as good as an annotated one
_STANDING_MPS = 0.1


def instance_names(frame: Frame) -> list[str]:
    """A name for every box of a frame: its instance id, or one of its own where the recording knows none."""
    boxes = frame.boxes_world
    if boxes is None:
        return []
    return [str(name) or f"{frame.token}/{row}" for row, name in enumerate(boxes.instance_ids)]


@dataclass(frozen=True, eq=False)
class BoxAt:
    """A box at one time.

    Args:
        world_from_box: pose; origin at the centre, x along the heading, z up.
        size_m: (3,) length, width, height.
        reliable: annotated, interpolated, or standing still; not extrapolated.
    """

    world_from_box: Pose
    size_m: Float[np.ndarray, "3"]
    reliable: bool


@dataclass(frozen=True, eq=False)
class Track:
    """The annotations of one instance, in time order.

    Args:
        name: instance id.
        label: the data set's category.
        times_ns: (k,) strictly increasing.
        centres_m: (k, 3) world.
        yaws_rad: (k,) world.
        sizes_m: (k, 3).
        velocities_mps: (k, 2) world, NaN where unknown.
    """

    name: str
    label: str
    times_ns: Int[np.ndarray, "k"]
    centres_m: Float[np.ndarray, "k 3"]
    yaws_rad: Float[np.ndarray, "k"]
    sizes_m: Float[np.ndarray, "k 3"]
    velocities_mps: Float[np.ndarray, "k 2"]

    @property
    def size_m(self) -> Float[np.ndarray, "3"]:
        """(3,) median size over time: annotators keep it nearly constant."""
        return np.asarray(np.median(self.sizes_m, axis=0))

    def at(self, time_ns: int, key_interval_ns: int) -> BoxAt | None:
        """The box at a time: centre linear, yaw along the shorter arc, between the two annotations around it.

        Beyond the annotated span it goes on at its velocity. None where the nearest annotation is more than a key interval
        away, be it outside of the span or in a gap of it.
        """
        times = self.times_ns
        if int(np.abs(times - time_ns).min()) > key_interval_ns:
            return None
        after = int(np.searchsorted(times, time_ns))
        if after < len(times) and times[after] == time_ns:
            return self._box(self.centres_m[after], float(self.yaws_rad[after]), True)
        if 0 < after < len(times):
            before = after - 1
            share = float(time_ns - times[before]) / float(times[after] - times[before])
            turn = float(wrap_angle(self.yaws_rad[after] - self.yaws_rad[before]))
            centre = (1 - share) * self.centres_m[before] + share * self.centres_m[after]
            return self._box(centre, float(self.yaws_rad[before]) + share * turn, True)
        end = 0 if after == 0 else len(times) - 1
        velocity = self._velocity(end)
        elapsed_s = float(time_ns - times[end]) * 1e-9
        centre = self.centres_m[end] + elapsed_s * velocity
        return self._box(centre, float(self.yaws_rad[end]), bool(np.linalg.norm(velocity) < _STANDING_MPS))

    def _velocity(self, row: int) -> Float[np.ndarray, "3"]:
        """(3,) m/s at an end of the track: of the last step, or as annotated, or none."""
        if len(self.times_ns) > 1:
            a, b = (0, 1) if row == 0 else (row - 1, row)
            elapsed_s = float(self.times_ns[b] - self.times_ns[a]) * 1e-9
            return np.asarray((self.centres_m[b] - self.centres_m[a]) / elapsed_s)
        return np.append(np.nan_to_num(self.velocities_mps[row]), 0.0)

    def _box(self, centre_m: Float[np.ndarray, "3"], yaw_rad: float, reliable: bool) -> BoxAt:
        return BoxAt(Pose.from_euler(yaw_rad, 0.0, 0.0, centre_m), self.size_m, reliable)


def build_tracks(frames: Sequence[Frame]) -> dict[str, Track]:
    """Tracks of all instances of a scene, by name, in the order of their first appearance.

    Raises:
        ValueError: frames out of order, or an instance twice in one frame.
    """
    times = [f.timestamp_ns for f in frames]
    if any(b <= a for a, b in pairwise(times)):
        raise ValueError("the frames of a scene are not in time order: sort them by timestamp_ns")
    rows: dict[str, list[tuple[Frame, int]]] = {}
    for frame in frames:
        names = instance_names(frame)
        if len(set(names)) != len(names):
            twice = next(n for n in names if names.count(n) > 1)
            raise ValueError(f"frame {frame.token}: instance '{twice}' is annotated twice; correct the annotations")
        for row, name in enumerate(names):
            rows.setdefault(name, []).append((frame, row))
    return {name: _track(name, seen) for name, seen in rows.items()}


def _track(name: str, seen: list[tuple[Frame, int]]) -> Track:
    tables = [(frame.timestamp_ns, frame.boxes_world, row) for frame, row in seen]
    boxes = [b[row : row + 1] for _, b, row in tables if b is not None]
    return Track(
        name,
        str(boxes[0].labels[0]),
        np.array([t for t, _, _ in tables], dtype=np.int64),
        np.concatenate([b.centre_m for b in boxes]),
        np.concatenate([b.yaw_rad for b in boxes]),
        np.concatenate([b.size_m for b in boxes]),
        np.concatenate([b.velocity_mps for b in boxes]),
    )


def key_interval_ns(frames: Sequence[Frame]) -> int:
    """Usual time between key frames; 0.5 s for a single one."""
    if len(frames) < 2:
        return DEFAULT_KEY_INTERVAL_NS
    return int(np.median(np.diff([f.timestamp_ns for f in frames])))
