"""The frames before a frame, for detectors that look back."""

from __future__ import annotations

from collections.abc import Sequence

from coin3d.datasets.frame import Frame, Recording


class FramesBefore:
    """Finds earlier frames of a scene by their tokens.

    Args:
        frames: where to look: a recording, or any sequence of frames.
    """

    def __init__(self, frames: Recording | Sequence[Frame]) -> None:
        self.frames = frames
        self._places: dict[str, int] | None = None

    def __call__(self, frame: Frame, count: int, place: int | None = None) -> list[Frame]:
        """The ``count`` frames before a frame, latest first.

        Where a scene begins, its first frame stands in for those before it, as if the vehicle had stood still.

        Args:
            frame: a frame.
            count: how many.
            place: index of ``frame``, if known: neighbours are then found without reading all frames once.
        """
        found = [frame]
        for step in range(count):
            latest = found[-1]
            found.append(self._before(latest, None if place is None else place - step) or latest)
        return found[1:]

    def _before(self, frame: Frame, place: int | None) -> Frame | None:
        if not frame.previous:
            return None
        if place is not None and place > 0 and (neighbour := self.frames[place - 1]).token == frame.previous:
            return neighbour
        if self._places is None:
            self._places = {f.token: i for i, f in enumerate(self.frames)}
        index = self._places.get(frame.previous)
        return None if index is None else self.frames[index]
