"""Damaged calibration files of other tools: Kalibr, ROS, COLMAP."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from coin3d.geometry import Rig
from coin3d.rig_import import Base, import_rig
from fuzzing import broken_json, damaged, refused

TIMES = 50
LEVEL = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
EYE = {
    "camera_model": "pinhole",
    "intrinsics": [60.0, 61.0, 47.5, 31.5],
    "distortion_model": "radtan",
    "distortion_coeffs": [-0.1, 0.01, 0.0, 0.0],
    "resolution": [96, 64],
}
KALIBR: dict[str, Any] = {"cam0": {**EYE, "T_cam_imu": LEVEL}, "cam1": {**EYE, "T_cn_cnm1": LEVEL}}
ROS: list[dict[str, Any]] = [
    {
        "transforms": [
            {
                "header": {"frame_id": "base_link"},
                "child_frame_id": "front_optical_frame",
                "transform": {
                    "translation": {"x": 1.5, "y": 0.0, "z": 1.4},
                    "rotation": {"x": -0.5, "y": 0.5, "z": -0.5, "w": 0.5},
                },
            }
        ]
    },
    {
        "header": {"frame_id": "front_optical_frame"},
        "height": 64,
        "width": 96,
        "distortion_model": "plumb_bob",
        "D": [-0.1, 0.01, 0.0, 0.0, 0.0],
        "K": [60.0, 0.0, 47.5, 0.0, 61.0, 31.5, 0.0, 0.0, 1.0],
        "R": [1, 0, 0, 0, 1, 0, 0, 0, 1],
        "P": [60.0, 0, 47.5, 0, 0, 61.0, 31.5, 0, 0, 0, 1, 0],
        "binning_x": 0,
        "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0},
    },
]
CAMERAS = "# list\n1 OPENCV 96 64 60 61 48 32 -0.1 0.01 0 0\n2 PINHOLE 96 64 60 61 48 32\n"
IMAGES = "# list\n1 1 0 0 0 0 0 0 1 front/1.jpg\n1 2 3\n2 1 0 0 0 -1 0 0 2 right/1.jpg\n\n"
FRONT = Base(pose=(1.5, 0.0, 1.4, 0.0, 0.0, 0.0))


def kalibr(path: Path) -> Rig:
    return import_rig(path, FRONT, format="kalibr")[0]


def ros(path: Path) -> Rig:
    return import_rig(path, Base(), format="ros")[0]


def colmap(path: Path) -> Rig:
    return import_rig(path, FRONT, format="colmap", scale=1.0)[0]


@pytest.mark.parametrize(("read", "content"), [(kalibr, KALIBR), (ros, ROS)])
def test_yaml_with_values_that_make_no_sense(tmp_path: Path, read: Callable[[Path], Rig], content: Any) -> None:
    rng = np.random.default_rng(0)
    path = tmp_path / "calibration.yaml"
    complaints = 0
    for _ in range(3 * TIMES):
        text, _ = broken_json(content, rng)
        documents = json.loads(text)
        # JSON is YAML, and a document of ROS ends with a line of dashes
        parts = documents if isinstance(documents, list) else [documents]
        path.write_text("\n---\n".join(json.dumps(p).replace("NaN", ".nan").replace("Infinity", ".inf") for p in parts))
        rig = refused(lambda: read(path), str(path))
        complaints += rig is None
        assert rig is None or all(1 <= camera.width_px <= 32767 for camera in rig.values())
    assert complaints > TIMES


@pytest.mark.parametrize(("read", "content"), [(kalibr, [KALIBR]), (ros, ROS)])
def test_yaml_cut_off_or_flipped(tmp_path: Path, read: Callable[[Path], Rig], content: list[Any]) -> None:
    rng = np.random.default_rng(1)
    path = tmp_path / "calibration.yaml"
    whole = yaml.safe_dump_all(content, sort_keys=False).encode()
    for _ in range(TIMES):
        path.write_bytes(damaged(whole, rng))
        refused(lambda: read(path), str(path))


BOMB = "\n".join(["l0: &l0 {cam0: 0}", *(f"l{i}: &l{i} {{<<: [{', '.join([f'*l{i - 1}'] * 20)}]}}" for i in range(1, 9))])


@pytest.mark.parametrize("read", [kalibr, ros])
@pytest.mark.parametrize(
    "text", [BOMB, "cam0: !!timestamp x", "K: !!bool x", "cam0: 2001-99-99", "- " * 3000, "a: 0x" + "f" * 9000]
)
def test_yaml_that_asks_for_trouble(tmp_path: Path, read: Callable[[Path], Rig], text: str) -> None:
    path = tmp_path / "calibration.yaml"
    path.write_text(text)
    assert refused(lambda: read(path), str(path)) is None


@pytest.mark.parametrize("damage_cameras", [True, False])
def test_colmap_cut_off_or_flipped(tmp_path: Path, damage_cameras: bool) -> None:
    rng = np.random.default_rng(2)
    files = {"cameras.txt": CAMERAS.encode(), "images.txt": IMAGES.encode()}
    name = "cameras.txt" if damage_cameras else "images.txt"
    for other, content in files.items():
        (tmp_path / other).write_bytes(content)
    assert list(colmap(tmp_path)) == ["front", "right"]
    for _ in range(3 * TIMES):
        (tmp_path / name).write_bytes(damaged(files[name], rng))
        refused(lambda: colmap(tmp_path), str(tmp_path))


@pytest.mark.parametrize("word", ["0", "-1", "nan", "inf", "1e999", "9" * 400, "x", "", "../..", "\x00"])
def test_colmap_words_that_make_no_sense(tmp_path: Path, word: str) -> None:
    for name, text in {"cameras.txt": CAMERAS, "images.txt": IMAGES}.items():
        lines = text.splitlines()
        for row in (1, 2, 3):
            for column in range(len(lines[row].split()) if row < len(lines) else 0):
                words = lines[row].split()
                words[column] = word
                for other, content in {"cameras.txt": CAMERAS, "images.txt": IMAGES}.items():
                    (tmp_path / other).write_text(content)
                (tmp_path / name).write_text("\n".join([*lines[:row], " ".join(words), *lines[row + 1 :]]) + "\n")
                rig = refused(lambda: colmap(tmp_path), str(tmp_path))
                assert rig is None or all(np.isfinite(camera.ego_from_cam.matrix).all() for camera in rig.values())


def test_a_focal_length_of_zero_is_named(tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 96 64 60 0 48 32\n")
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 1 front.jpg\n\n")
    with pytest.raises(ValueError, match=r"cameras\.txt, line 1: a focal length is more than 0, got 0"):
        colmap(tmp_path)
