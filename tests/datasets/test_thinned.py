from __future__ import annotations

from pathlib import Path

import pytest

from coin3d.datasets.frames_before import FramesBefore
from coin3d.datasets.nuscenes_format import NuScenesRecording
from coin3d.datasets.thinned import Thinned, scene_names
from tiny_recording import write_recording


def links(recording: Thinned) -> list[tuple[str, str, str]]:
    return [
        (f.token.removeprefix("sample"), f.previous.removeprefix("sample"), f.next.removeprefix("sample")) for f in recording
    ]


@pytest.fixture
def long(tmp_path: Path) -> NuScenesRecording:
    return NuScenesRecording(write_recording(tmp_path / "long", scenes=2, samples=6, files=False))


def test_every_fourth_frame_of_each_scene(long: NuScenesRecording) -> None:
    thinned = Thinned(long, every=4)
    assert links(thinned) == [("0.0", "", "0.4"), ("0.4", "0.0", ""), ("1.0", "", "1.4"), ("1.4", "1.0", "")]
    assert thinned.scene_names() == ["street-0", "street-0", "street-1", "street-1"]
    assert [f.token for f in FramesBefore(thinned)(thinned[1], 1, 1)] == ["sample0.0"]


def test_every_frame_with_the_fourth_before_it(long: NuScenesRecording) -> None:
    thinned = Thinned(long, look_back=4)
    assert len(thinned) == 12
    assert links(thinned)[:6] == [
        ("0.0", "", "0.4"), ("0.1", "", "0.5"), ("0.2", "", ""), ("0.3", "", ""), ("0.4", "0.0", ""), ("0.5", "0.1", ""),
    ]  # fmt: skip
    assert [f.token for f in FramesBefore(thinned)(thinned[5], 1)] == ["sample0.1"]
    assert [f.token for f in FramesBefore(thinned)(thinned[6], 1)] == ["sample1.0"], "a scene begins: it stands in for itself"


def test_nothing_changes_with_one_and_less_is_refused(long: NuScenesRecording) -> None:
    same = Thinned(long)
    assert [(f.token, f.previous, f.next) for f in same] == [(f.token, f.previous, f.next) for f in long]
    with pytest.raises(ValueError, match="at least 1, got 0, 1"):
        Thinned(long, every=0)


def test_recordings_that_do_not_know_their_scenes_are_asked_frame_by_frame(long: NuScenesRecording) -> None:
    frames = list(long)
    assert scene_names(frames) == long.scene_names()
    assert links(Thinned(frames, every=5)) == links(Thinned(long, every=5))
