"""What Lyft does differently, on a recording whose every number is known."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from coin3d.datasets.lidar_file import LidarFile
from coin3d.datasets.lyft_files import CUT_SHORT
from coin3d.datasets.nuscenes_format import NuScenesRecording
from coin3d.geometry import Pose
from tiny_recording import START_US, edit_table

Rows = list[dict[str, Any]]


def test_the_zoomed_camera_is_read_on_request_only(tiny_recording: Path) -> None:
    edit_table(tiny_recording, "sensor", lambda rows: rows[2].update(channel="CAM_FRONT_ZOOMED"))
    assert list(NuScenesRecording(tiny_recording)[0].rig) == ["CAM_FRONT", "CAM_BACK"]
    wanted = NuScenesRecording(tiny_recording, cameras=["CAM_FRONT_ZOOMED", "CAM_FRONT"])
    assert list(wanted[0].rig) == ["CAM_FRONT", "CAM_FRONT_ZOOMED"] == list(wanted[0].images)
    with pytest.raises(ValueError, match=r"sensor\.json: no camera CAM_TOP, only CAM_BACK, CAM_FRONT, CAM_FRONT_ZOOMED"):
        NuScenesRecording(tiny_recording, cameras=["CAM_TOP"])


def test_other_lidars_beside_the_top_one_are_left_out(tiny_recording: Path) -> None:
    def more_lidars(rows: Rows) -> None:
        rows += [{**rows[-1], "token": name, "channel": name} for name in ("LIDAR_FRONT_LEFT", "LIDAR_FRONT_RIGHT")]

    def calibrated(rows: Rows) -> None:
        rows += [{**rows[-1], "token": f"c_{n}", "sensor_token": n} for n in ("LIDAR_FRONT_LEFT", "LIDAR_FRONT_RIGHT")]

    def data(rows: Rows) -> None:
        tops = [row for row in rows if row["calibrated_sensor_token"] == "calibrated_LIDAR_TOP"]
        rows += [
            {**row, "token": f"{row['token']}{n}", "calibrated_sensor_token": f"c_{n}", "filename": "lidar/none.bin"}
            for row in tops
            for n in ("LIDAR_FRONT_LEFT", "LIDAR_FRONT_RIGHT")
        ]

    edit_table(tiny_recording, "sensor", more_lidars)
    edit_table(tiny_recording, "calibrated_sensor", calibrated)
    edit_table(tiny_recording, "sample_data", data)
    recording = NuScenesRecording(tiny_recording)
    assert recording[1].lidar.path.parent.name == "LIDAR_TOP"
    assert {sweep.path.parent.name for _, sweep in recording.sweeps(recording[0])} == {"LIDAR_TOP"}


def test_decimal_times_unknown_counts_and_several_attributes(tiny_recording: Path) -> None:
    for table in ("sample", "sample_data", "ego_pose"):
        edit_table(tiny_recording, table, lambda rows: [row.update(timestamp=row["timestamp"] + 0.2) for row in rows])
    attributes = {"num_lidar_pts": -1, "attribute_tokens": ["parked", "standing"], "visibility_token": ""}
    edit_table(tiny_recording, "sample_annotation", lambda rows: [row.update(attributes) for row in rows])
    frame = NuScenesRecording(tiny_recording)[0]
    assert frame.timestamp_ns == START_US * 1000 and isinstance(frame.timestamp_ns, int)
    assert frame.boxes.num_lidar_points.tolist() == [-1, -1] and frame.boxes.visibility.tolist() == [0, 0]
    np.testing.assert_allclose(frame.boxes_world.velocity_mps[0], [2.0, 0.0], atol=1e-6)


def test_two_image_sizes_in_one_recording(tiny_recording: Path) -> None:
    def small(rows: Rows) -> None:
        for row in rows:
            if row["sample_token"].startswith("sample1"):
                row.update(width=48, height=32)

    edit_table(tiny_recording, "sample_data", small)
    recording = NuScenesRecording(tiny_recording)
    sizes = [(f.rig["CAM_FRONT"].width_px, f.rig["CAM_FRONT"].height_px) for f in recording]
    assert sizes == [(96, 64)] * 3 + [(48, 32)] * 3


def test_the_ground_keeps_its_height_where_the_world_lies_below_zero(tiny_recording: Path) -> None:
    def lower(rows: Rows) -> None:
        for row in rows:
            row["translation"][2] -= 18.6

    before = NuScenesRecording(tiny_recording)[1]
    for table in ("ego_pose", "sample_annotation"):
        edit_table(tiny_recording, table, lower)
    frame = NuScenesRecording(tiny_recording)[1]
    assert frame.world_from_ego.translation[2] == pytest.approx(-18.6)
    np.testing.assert_allclose(frame.boxes.centre_m, before.boxes.centre_m, atol=1e-9)
    assert frame.rig["CAM_FRONT"].height_m == pytest.approx(1.5)


def test_the_one_file_that_ends_within_a_point(tmp_path: Path) -> None:
    points = np.arange(10, dtype="<f4")
    for name, floats, whole in ((CUT_SHORT, 13, True), (CUT_SHORT, 12, False), ("host-a011_lidar1_1.bin", 13, False)):
        path = tmp_path / name
        np.concatenate([points, np.zeros(floats - 10, "<f4")]).tofile(path)
        file = LidarFile(path, Pose.identity())
        if whole:
            assert file.load().points_ego.tolist() == [[0, 1, 2], [5, 6, 7]]
        else:
            with pytest.raises(ValueError, match=f"has {4 * floats} bytes, not a whole number of 20-byte points"):
                file.load()
    points.tofile(tmp_path / CUT_SHORT)
    assert len(LidarFile(tmp_path / CUT_SHORT, Pose.identity()).load().points_ego) == 2, "a mended copy is read as it is"


@pytest.mark.parametrize("layout", ["beside", "within", "as downloaded"])
def test_where_tables_and_images_may_lie(tiny_recording: Path, tmp_path: Path, layout: str) -> None:
    def renamed(rows: Rows) -> None:
        for row in rows:
            _, channel, name = row["filename"].split("/")
            row["filename"] = f"{'lidar' if 'LIDAR' in channel else 'images'}/{channel}_{name}"

    edit_table(tiny_recording, "sample_data", renamed)
    root = tmp_path / "lyft"
    places = {
        "beside": ("v1.01-train/v1.01-train", "images", "lidar"),
        "within": ("v1.01-train/v1.01-train", "v1.01-train/images", "v1.01-train/lidar"),
        "as downloaded": ("train_data", "train_images", "train_lidar"),
    }
    tables, images, lidar = (root / place for place in places[layout])
    shutil.copytree(tiny_recording / "v1.0-tiny", tables)
    for folder in (images, lidar):
        folder.mkdir(parents=True, exist_ok=True)
    for path in (tiny_recording / "samples").glob("*/*"):
        shutil.copy(path, (lidar if path.suffix == ".bin" else images) / f"{path.parent.name}_{path.name}")
    opened = [NuScenesRecording(root)]
    if layout == "within":
        opened.append(NuScenesRecording(root / "v1.01-train"))
    for recording in opened:
        assert recording[0].image("CAM_FRONT").shape == (64, 96, 3)
        assert len(recording[0].lidar.load().points_ego) > 100


@pytest.mark.parametrize("name", ["../secret.jpg", "/etc/passwd", "images/../../x", "C:/x.jpg", "", "a\x00b", "x" * 300])
def test_file_names_that_lead_elsewhere(tiny_recording: Path, name: str) -> None:
    edit_table(tiny_recording, "sample_data", lambda rows: rows[0].update(filename=name))
    with pytest.raises(ValueError, match=r"sample_data\.json: row 'samples/CAM_BACK/0_0\.jpg': filename: "):
        NuScenesRecording(tiny_recording)[0]
