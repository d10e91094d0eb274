"""Damaged nuScenes-format recordings: each gives one error that says which file, row and remedy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from coin3d.datasets.nuscenes_format import NuScenesRecording
from coin3d.datasets.nuscenes_tables import TABLES
from tiny_recording import CAMERAS, edit_table

Rows = list[dict[str, Any]]


@pytest.mark.parametrize("table", TABLES)
def test_missing_and_truncated_tables(tiny_recording: Path, table: str) -> None:
    path = tiny_recording / "v1.0-tiny" / f"{table}.json"
    content = path.read_text()
    path.write_text(content[: len(content) // 2])
    with pytest.raises(ValueError, match=rf"{table}\.json: not a JSON list"):
        NuScenesRecording(tiny_recording, "v1.0-tiny")
    path.unlink()
    with pytest.raises(
        FileNotFoundError, match="nuScenes-format tables" if table == "sample" else rf"{table}\.json: this table"
    ):
        NuScenesRecording(tiny_recording, "v1.0-tiny")


@pytest.mark.parametrize(
    ("table", "field"),
    [
        ("sample", "scene_token"),
        ("sample_data", "sample_token"),
        ("sample_data", "ego_pose_token"),
        ("sample_data", "calibrated_sensor_token"),
        ("calibrated_sensor", "sensor_token"),
        ("sample_annotation", "sample_token"),
        ("sample_annotation", "instance_token"),
        ("instance", "category_token"),
    ],
)
def test_dangling_tokens_name_table_row_and_token(tiny_recording: Path, table: str, field: str) -> None:
    edit_table(tiny_recording, table, lambda rows: rows[0].update({field: "lost"}))
    with pytest.raises(ValueError, match=rf"{table}\.json: {field} of row '.+' is 'lost', which is not in \w+\.json"):
        NuScenesRecording(tiny_recording)


def test_missing_field_and_repeated_token(tiny_recording: Path) -> None:
    edit_table(tiny_recording, "sample_data", lambda rows: rows[0].pop("ego_pose_token"))
    with pytest.raises(ValueError, match=r"sample_data\.json: row 'samples/.+' has no field 'ego_pose_token'"):
        NuScenesRecording(tiny_recording)
    edit_table(tiny_recording, "scene", lambda rows: rows.append(rows[0]))
    with pytest.raises(ValueError, match=r"scene\.json: 1 rows repeat the token"):
        NuScenesRecording(tiny_recording)


def test_empty_scene_and_empty_recording(tiny_recording: Path) -> None:
    edit_table(tiny_recording, "scene", lambda rows: rows.append({"token": "nothing", "name": "nothing"}))
    with pytest.raises(ValueError, match=r"scene\.json: scene 'nothing' has no samples"):
        NuScenesRecording(tiny_recording)
    for table in ("scene", "sample", "sample_data", "sample_annotation"):
        edit_table(tiny_recording, table, lambda rows: rows.clear())
    with pytest.raises(ValueError, match=r"sample\.json: the recording has no samples"):
        NuScenesRecording(tiny_recording)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"camera_intrinsic": [[float("nan"), 0, 50], [0, 60, 30], [0, 0, 1]]}, "not finite"),
        ({"camera_intrinsic": [[0, 0, 50], [0, 60, 30], [0, 0, 1]]}, "singular"),
        ({"camera_intrinsic": []}, "3 x 3 matrix"),
        ({"rotation": [0.5, 0.5, 0.5, 0.9]}, "has length 1"),
        ({"rotation": [1, 0, 0]}, "has length 1"),
        ({"translation": [0, float("inf"), 1.5]}, "not finite"),
    ],
)
def test_calibrations_that_make_no_sense(tiny_recording: Path, change: dict[str, Any], message: str) -> None:
    edit_table(tiny_recording, "calibrated_sensor", lambda rows: rows[0].update(change))
    with pytest.raises(ValueError, match=rf"calibrated_sensor\.json: row 'calibrated_CAM_BACK': .*{message}"):
        NuScenesRecording(tiny_recording)[0]


def test_annotation_without_volume(tiny_recording: Path) -> None:
    edit_table(tiny_recording, "sample_annotation", lambda rows: rows[0].update(size=[2.0, 0.0, 1.5]))
    with pytest.raises(ValueError, match=r"sample_annotation\.json: annotations of sample 'sample0\.0': .*positive metres"):
        NuScenesRecording(tiny_recording)[0]


def test_inverted_camera_poses_are_recognised(tiny_recording: Path) -> None:
    def invert(rows: Rows) -> None:
        for row, pose in zip(rows, CAMERAS.values(), strict=False):
            row.update(translation=pose.inverse().translation.tolist(), rotation=pose.inverse().quaternion.tolist())

    edit_table(tiny_recording, "calibrated_sensor", invert)
    with pytest.raises(ValueError, match=r"calibrated_sensor\.json: camera .*below the ground.*cam_from_ego"):
        NuScenesRecording(tiny_recording)[0]


def test_sample_without_cameras(tiny_recording: Path) -> None:
    def drop(rows: Rows) -> None:
        rows[:] = [r for r in rows if not (r["sample_token"] == "sample0.1" and "LIDAR" not in r["filename"])]

    edit_table(tiny_recording, "sample_data", drop)
    recording = NuScenesRecording(tiny_recording)
    assert len(recording[0].rig) == 3
    with pytest.raises(ValueError, match=r"sample 'sample0\.1' has no camera images"):
        recording[1]


def test_missing_and_truncated_lidar(tiny_recording: Path) -> None:
    frame = NuScenesRecording(tiny_recording)[0]
    path = tiny_recording / "samples/LIDAR_TOP/0_0_0.bin"
    path.write_bytes(path.read_bytes()[:-12])
    with pytest.raises(ValueError, match=r"0_0_0\.bin: the LiDAR file has \d+ bytes, not a whole number of 20-byte points"):
        frame.lidar.load()
    path.write_bytes(b"")
    with pytest.raises(ValueError, match="has 0 bytes"):
        frame.lidar.load()
    path.unlink()
    with pytest.raises(ValueError, match=r"0_0_0\.bin: the LiDAR file is missing"):
        frame.lidar.load()


def test_missing_truncated_and_mislabelled_images(tiny_recording: Path) -> None:
    recording = NuScenesRecording(tiny_recording)
    path = tiny_recording / "samples/CAM_FRONT/0_0.jpg"
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match=r"0_0\.jpg: the JPEG is truncated"):
        recording[0].image("CAM_FRONT")
    path.write_bytes(b"no image\xff\xd9")
    with pytest.raises(ValueError, match=r"0_0\.jpg: cannot be decoded"):
        recording[0].image("CAM_FRONT")
    path.unlink()
    with pytest.raises(ValueError, match=r"0_0\.jpg: the image file is missing"):
        recording[0].image("CAM_FRONT")
    edit_table(tiny_recording, "sample_data", lambda rows: [row.update(width=100) for row in rows])
    with pytest.raises(ValueError, match=r"sample0\.1, CAM_FRONT: .* is 96 x 64 pixels but the rig says 100 x 64"):
        NuScenesRecording(tiny_recording)[1].image("CAM_FRONT")
