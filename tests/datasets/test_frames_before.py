"""Frames before a frame: by neighbour, by token, and where a scene begins."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from coin3d.datasets.frame import Frame
from coin3d.datasets.frames_before import FramesBefore
from small_world import MemoryRecording, frame, ring_rig


def scene(*seeds: int) -> list[Frame]:
    """Frames of one scene, linked in the given order."""
    frames = [frame(seed, ring_rig(1)) for seed in seeds]
    return [replace(f, previous=frames[i - 1].token if i else "") for i, f in enumerate(frames)]


class Counting(MemoryRecording):
    """Knows how often it was read from beginning to end."""

    passes = 0

    def __iter__(self) -> Iterator[Frame]:
        self.passes += 1
        return super().__iter__()


def tokens(frames: list[Frame]) -> list[str]:
    return [f.token for f in frames]


def test_latest_first_and_the_first_frame_of_a_scene_stands_in() -> None:
    frames = scene(0, 1, 2) + scene(10, 11)
    before = FramesBefore(MemoryRecording(frames))
    assert tokens(before(frames[2], 2, 2)) == ["frame1", "frame0"]
    assert tokens(before(frames[1], 3, 1)) == ["frame0", "frame0", "frame0"]
    assert tokens(before(frames[3], 1, 3)) == ["frame10"]
    assert before(frames[2], 0, 2) == []


def test_neighbours_are_found_without_reading_the_recording() -> None:
    frames = scene(0, 1, 2)
    recording = Counting(frames)
    before = FramesBefore(recording)
    before(frames[2], 2, 2)
    assert recording.passes == 0
    assert tokens(before(frames[2], 2)) == ["frame1", "frame0"] and recording.passes == 1
    before(frames[1], 1)
    assert recording.passes == 1


def test_frames_in_another_order_and_frames_that_are_missing() -> None:
    first, second, third = scene(0, 1, 2)
    shuffled = FramesBefore([third, first, second])
    assert tokens(shuffled(third, 2, 0)) == ["frame1", "frame0"]
    assert tokens(FramesBefore([third])(third, 1)) == ["frame2"]
