"""Pictures of detections: order of cameras, colours, what is drawn."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from coin3d.datasets.frame import Frame
from coin3d.drawing.colours import PREDICTION, TRUTH, class_colour
from coin3d.geometry import Boxes3D, preset_rig
from coin3d.report.pictures import as_seen, frame_pictures, likely
from small_world import ring_rig

RIG = ring_rig(2)
BOXES = Boxes3D.create([[10, 0, 0.8], [14, 3, 0.8]], [[4, 2, 1.6], [4, 2, 1.6]], [0.0, 0.3], ["car", "car"], scores=[0.9, 0.1])


def frame() -> Frame:
    return Frame("f", 0, RIG, {name: np.full((64, 96, 3), 60, np.uint8) for name in RIG})


@pytest.mark.parametrize(
    ("preset", "order"),
    [
        ("nuscenes", ["FRONT_LEFT", "FRONT", "FRONT_RIGHT", "BACK_LEFT", "BACK", "BACK_RIGHT"]),
        ("waymo", ["FRONT_LEFT", "FRONT", "FRONT_RIGHT", "SIDE_LEFT", "SIDE_RIGHT"]),
    ],
)
def test_cameras_stand_as_one_would_see_them(preset: str, order: list[str]) -> None:
    assert [name.removeprefix("CAM_") for name in as_seen(preset_rig(preset))] == order


def has(image: np.ndarray, colour: tuple[int, int, int]) -> bool:
    return bool((np.abs(image.astype(int) - colour).max(-1) < 25).any())


def test_truth_and_predictions_have_their_colours() -> None:
    shown = frame_pictures(frame(), BOXES[:1], BOXES[1:])
    assert has(shown.above, TRUTH) and has(shown.above, PREDICTION)
    without = frame_pictures(frame(), BOXES[:0], BOXES[:0])
    assert not has(without.above, TRUTH) and not has(without.above, PREDICTION)


def test_predictions_alone_are_coloured_by_class() -> None:
    assert has(frame_pictures(frame(), BOXES).above, class_colour("car"))


def test_saved_pictures_are_whole_and_safely_named(tmp_path: Path) -> None:
    paths = frame_pictures(frame(), BOXES, top_px=200).save(tmp_path, "scene/1: a")
    assert [p.name for p in paths] == ["scene_1__a_cameras.png", "scene_1__a_top.png"]
    assert cv2.imread(str(paths[1])).shape == (200, 200, 3)


def test_likely() -> None:
    assert likely(BOXES, 0.5).scores.tolist() == [0.9] and len(likely(BOXES, 0.0)) == 2
