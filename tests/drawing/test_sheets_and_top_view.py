"""Sheets of pictures, and the scene from above."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from coin3d.drawing.colours import BACKGROUND, PREDICTION, TRUTH, class_colour
from coin3d.drawing.sheet import Panel, class_legend, message_picture, save_png, sheet
from coin3d.drawing.text import shortened, text_size
from coin3d.drawing.top_view import top_view
from coin3d.geometry import Boxes3D, preset_rig


def _where(image: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    return np.argwhere((np.abs(image.astype(int) - colour) < 12).all(-1))


def test_top_view_puts_forward_up_and_left_left() -> None:
    ahead_left = Boxes3D.create([[20.0, 10.0, 1.0]], [[4, 2, 1.5]], [0.0], ["car"])
    image = top_view(preset_rig("waymo"), ahead_left, range_m=50, size_px=500)
    rows, columns = _where(image, class_colour("car")).T
    assert (rows.min() + rows.max()) / 2 == pytest.approx(250 - 20 * 5, abs=5)
    assert (columns.min() + columns.max()) / 2 == pytest.approx(250 - 10 * 5, abs=2)
    # the tick goes on beyond the front, never beyond the rear
    assert 150 - rows.min() > rows.max() - 150 + 2


def test_top_view_tells_truth_from_predictions() -> None:
    truth = Boxes3D.create([[20.0, 10.0, 1.0]], [[4, 2, 1.5]], [0.0], ["car"])
    found = Boxes3D.create([[-20.0, 10.0, 1.0]], [[4, 2, 1.5]], [0.0], ["car"])
    image = top_view(preset_rig("nuscenes"), truth, found, np.array([[30.0, 0, 0.0], [400.0, 0, 0]]), size_px=400)
    assert _where(image, TRUTH)[:, 0].max() < 200 < _where(image, PREDICTION)[:, 0].min()
    assert TRUTH[0] > 2 * TRUTH[1] and PREDICTION[1] > 1.5 * PREDICTION[0]  # red and green


def test_sheet_keeps_proportions_of_unequal_pictures() -> None:
    wide = np.full((50, 100, 3), 200, dtype=np.uint8)
    high = np.full((300, 100, 3), 100, dtype=np.uint8)
    image = sheet(
        [Panel(wide, "wide"), Panel(high, "high"), Panel(wide, "again")], 2, 200, "title", class_legend(["car", "car"])
    )
    assert image.shape[1] == 2 * (200 + 8) + 8
    assert (image == 200).all(-1).sum() == 2 * 200 * 100
    assert (image == 100).all(-1).sum() == 200 * 600
    with pytest.raises(ValueError, match="at least one"):
        sheet([], 2)


def test_text_fits() -> None:
    assert shortened("short", 12, 500) == "short"
    cut = shortened("a very long name of a camera", 12, 90)
    assert cut.endswith("..") and text_size(cut, 12)[0] <= 90
    picture = message_picture("word " * 60, 400, 300)
    assert picture.shape == (300, 400, 3)
    assert (picture[:, 390:] == (48, 30, 30)).all()


def test_png_keeps_colours_and_leaves_no_partial_file(tmp_path: Path) -> None:
    image = np.zeros((4, 5, 3), dtype=np.uint8)
    image[..., 0] = 250
    path = save_png(image, tmp_path / "new" / "red.png")
    assert [p.name for p in path.parent.iterdir()] == ["red.png"]
    assert cv2.imread(str(path))[0, 0].tolist() == [0, 0, 250]


def test_class_colours_are_steady_and_distinct() -> None:
    assert class_colour("vehicle.car") == class_colour("car")
    assert class_colour("car") != class_colour("human.pedestrian.adult") != class_colour("CYCLIST")
    assert class_colour("spaceship") == class_colour("spaceship") != BACKGROUND
