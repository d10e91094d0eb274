"""``coin3d check``: counts, pictures, and every finding it promises."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from coin3d.check import CheckResult, check
from coin3d.check.rig_checks import rig_findings
from coin3d.geometry import Camera, GroundPlane, Pose, Rig, camera_pose, save_rig
from tiny_recording import CAMERAS, edit_table

Rows = list[dict[str, Any]]


def _texts(result: CheckResult, severity: str) -> str:
    return "\n".join(str(f) for f in result.findings if f.severity == severity)


def test_a_sound_recording(tiny_recording: Path, tmp_path: Path) -> None:
    result = check(tiny_recording, tmp_path / "out", frames=3)
    assert (result.frames, result.frames_checked, result.boxes) == (6, 3, 4)
    assert result.boxes_with_lidar_count == result.boxes_with_matching_lidar_count == 4
    assert result.categories == {"vehicle.car": 3, "human.pedestrian.adult": 1}
    assert abs(result.ground_height_m) < 0.01 and result.ground_tilt_deg < 0.1
    assert not _texts(result, "error") and not _texts(result, "warning")
    stored = json.loads((tmp_path / "out" / "result.json").read_text())
    assert stored["boxes"] == stored["boxes_with_matching_lidar_count"] == 4
    assert stored["findings"] == [f.as_dict() for f in result.findings]
    assert len(result.pictures) == 6
    for picture in result.pictures:
        assert cv2.imread(str(picture)) is not None
    assert not list((tmp_path / "out").glob("*.part"))


def test_pictures_are_printed(tiny_recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = check(tiny_recording, tmp_path / "out", frames=1)
    printed = capsys.readouterr().out
    assert all(str(picture) in printed for picture in result.pictures)


def test_own_images_get_a_ground_grid_and_notes(tmp_path: Path) -> None:
    root = tmp_path / "van"
    root.mkdir()
    K = np.array([[60.0, 0, 48], [0, 60, 32], [0, 0, 1]])
    save_rig(Rig({"front": Camera(K, 96, 64, camera_pose([1.5, 0, 1.4]))}), root / "rig.yaml")
    cv2.imwrite(str(root / "front.png"), np.zeros((64, 96, 3), dtype=np.uint8))
    result = check(root, tmp_path / "out")
    assert result.boxes == 0 and result.ground_height_m is None
    assert "front 1.40 m" in _texts(result, "note") and "no annotations" in _texts(result, "note")
    assert not _texts(result, "error") and not _texts(result, "warning")


def test_broken_files_are_findings_and_the_rest_is_drawn(tiny_recording: Path, tmp_path: Path) -> None:
    (tiny_recording / "samples/CAM_FRONT/0_0.jpg").unlink()
    lidar = tiny_recording / "samples/LIDAR_TOP/1_2_0.bin"
    lidar.write_bytes(lidar.read_bytes()[:-3])
    edit_table(tiny_recording, "sample_annotation", lambda rows: rows[2].update(size=[1, 1, -1]))
    result = check(tiny_recording, tmp_path / "out", frames=6)
    errors = _texts(result, "error")
    assert "0_0.jpg: the image file is missing" in errors
    assert "1_2_0.bin: the LiDAR file has" in errors
    assert "positive metres" in errors and "frame 1" in errors
    assert result.frames_checked == 5 and len(result.pictures) == 10
    assert result.findings[0].severity == "error"


def test_nothing_readable_is_one_error_and_writes_nothing(tiny_recording: Path, tmp_path: Path) -> None:
    for path in [*tiny_recording.rglob("*.jpg"), *tiny_recording.rglob("*.bin")]:
        path.unlink()
    with pytest.raises(
        ValueError, match=r"nothing of the checked frames can be read; first problem: .*the image file is missing"
    ):
        check(tiny_recording, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    with pytest.raises(ValueError, match="at least one frame"):
        check(tiny_recording, tmp_path / "out", frames=0)


def test_inverted_poses_are_said_plainly(tiny_recording: Path, tmp_path: Path) -> None:
    def invert(rows: Rows) -> None:
        for row, pose in zip(rows, CAMERAS.values(), strict=False):
            row.update(translation=pose.inverse().translation.tolist(), rotation=pose.inverse().quaternion.tolist())

    edit_table(tiny_recording, "calibrated_sensor", invert)
    with pytest.raises(ValueError, match="cam_from_ego seems to be stored"):
        check(tiny_recording, tmp_path / "out")


def test_wrong_counts_unknown_categories_and_floating_boxes(tiny_recording: Path, tmp_path: Path) -> None:
    def change(rows: Rows) -> None:
        rows[0].update(num_lidar_pts=9)
        for row in rows:
            row["translation"][2] += 0.02 if row["token"].startswith("ann_car0") else 1.0

    edit_table(tiny_recording, "sample_annotation", change)
    edit_table(tiny_recording, "category", lambda rows: rows[1].update(name="spaceship"))
    result = check(tiny_recording, tmp_path / "out", frames=6)
    warnings = _texts(result, "warning")
    # one is annotated with two more, and the three cars of the second scene float above some of theirs
    assert "sample1.0: 4 of 8 boxes hold another number of LiDAR points than annotated (largest difference 5)" in warnings
    assert "unknown categories: spaceship" in warnings
    assert "sample1.1: box bottoms lie +1.00 m from the ground" in warnings
    assert result.boxes_with_matching_lidar_count < result.boxes_with_lidar_count


def test_ground_that_contradicts_lidar(tiny_recording: Path, tmp_path: Path) -> None:
    def raise_sensors(rows: Rows) -> None:
        for row in rows:
            row["translation"][2] += 0.4

    edit_table(tiny_recording, "calibrated_sensor", raise_sensors)
    result = check(tiny_recording, tmp_path / "out")
    assert result.ground_height_m == pytest.approx(0.4, abs=0.02)
    assert "offset: -0.4" in _texts(result, "warning")


def test_time_gaps(tiny_recording: Path, tmp_path: Path) -> None:
    # frame 2 of the second scene comes a second late
    edit_table(
        tiny_recording,
        "sample_data",
        lambda rows: [r.update(timestamp=r["timestamp"] + 10**6) for r in rows if "/1_2" in r["filename"]],
    )
    assert "sample1.2: 1.50 s after the frame before, usually 0.50 s" in _texts(
        check(tiny_recording, tmp_path / "out"), "warning"
    )


def test_cameras_without_lidar_and_boxes_in_no_image(tiny_recording: Path, tmp_path: Path) -> None:
    up = camera_pose([1.0, 0.5, 1.6], 0.0, -np.pi / 2)

    def look_up(rows: Rows) -> None:
        for row in rows[:3]:
            row.update(rotation=up.quaternion.tolist())

    edit_table(tiny_recording, "calibrated_sensor", look_up)
    result = check(tiny_recording, tmp_path / "out")
    warnings = _texts(result, "warning")
    assert "CAM_FRONT: no LiDAR point falls into the image" in warnings
    assert "4 of 4 boxes have their centre in no image" in warnings
    assert "CAM_FRONT: the transform is mixed up: its axes are x forward" in _texts(result, "error")
    assert "CAM_FRONT: no pixel sees the ground" in warnings


K = np.array([[60.0, 0, 48], [0, 60, 32], [0, 0, 1]])


def _finding(pose: Pose, K: np.ndarray = K, ground: GroundPlane | None = None) -> str:
    rig = Rig({"eye": Camera(K, 96, 64, pose)}, ground or GroundPlane())
    return "\n".join(map(str, rig_findings(rig)))


def test_a_plausible_camera_has_no_findings() -> None:
    for yaw in np.linspace(-3, 3, 13):
        assert _finding(camera_pose([1.0, 0.2, 1.5], yaw, 0.3, 0.1)) == ""


def test_mixed_up_transforms_above_ground() -> None:
    # the camera of a high vehicle frame: inverted it still sits above the lowered ground
    assert "cam_from_ego is stored" in _finding(camera_pose([1.7, 0, 1.5]).inverse(), ground=GroundPlane(offset_m=2.5))
    assert "its axes are x forward" in _finding(Pose.from_euler(0.5, 0, 0, [1.7, 0, 1.5]))


def test_odd_mounts_and_intrinsics() -> None:
    assert "its image is turned 90 deg" in _finding(camera_pose([1, 0, 1.5], 0, 0, np.pi / 2))
    assert "it faces up or down" in _finding(camera_pose([1, 0, 1.5], 0, np.pi / 2))
    assert "unusual height" in _finding(camera_pose([1, 0, 9.0]))
    assert "far from the centre" in _finding(camera_pose([1, 0, 1.5]), K=np.array([[60.0, 0, 90], [0, 60, 32], [0, 0, 1]]))
    assert "field of view of 0.9 deg" in _finding(
        camera_pose([1, 0, 1.5], 0, 0.2), K=np.array([[6000.0, 0, 48], [0, 6000, 32], [0, 0, 1]])
    )
