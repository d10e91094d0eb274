"""A recording at another frame rate: every n-th frame of each scene, or neighbours that lie farther back."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from coin3d.datasets.frame import Frame, Recording


class Thinned:
    """Every ``every``-th frame of each scene; the frame before one is the ``look_back``-th before it among those kept.

    Waymo is labelled at 10 Hz where nuScenes is at 2 Hz: it is trained on every fourth frame, and tested on every frame with
    the fourth before it as the one before.

    Args:
        recording: where the frames come from.
        every: 1 keeps all.
        look_back: 1 leaves neighbours as they are among the frames kept.

    Raises:
        ValueError: a number below one.
    """

    def __init__(self, recording: Recording, every: int = 1, look_back: int = 1) -> None:
        if every < 1 or look_back < 1:
            raise ValueError(f"frames are thinned to every n-th and look n back with n of at least 1, got {every}, {look_back}")
        self.recording, self.look_back = recording, look_back
        by_scene: dict[str, list[int]] = {}
        for index, scene in enumerate(scene_names(recording)):
            by_scene.setdefault(scene, []).append(index)
        # place in the recording, and of the neighbours before and after
        self._places: list[tuple[int, int | None, int | None]] = []
        for indices in by_scene.values():
            kept = indices[::every]
            for i, index in enumerate(kept):
                before = kept[i - look_back] if i >= look_back else None
                after = kept[i + look_back] if i + look_back < len(kept) else None
                self._places.append((index, before, after))
        self._tokens: dict[int, str] = {}

    def __len__(self) -> int:
        return len(self._places)

    def __iter__(self) -> Iterator[Frame]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, index: int) -> Frame:
        """The frame at a position; raises what the recording raises."""
        place, before, after = self._places[index]
        return replace(self.recording[place], previous=self._token(before), next=self._token(after))

    def scene_names(self) -> list[str]:
        """The scene of every frame."""
        names = scene_names(self.recording)
        return [names[place] for place, _, _ in self._places]

    def _token(self, place: int | None) -> str:
        if place is None:
            return ""
        if place not in self._tokens:
            self._tokens[place] = self.recording[place].token
        return self._tokens[place]


def scene_names(recording: Recording) -> list[str]:
    """The scene of every frame: what the recording knows, or else by building all frames once."""
    known = getattr(recording, "scene_names", None)
    return list(known()) if known is not None else [frame.scene for frame in recording]
