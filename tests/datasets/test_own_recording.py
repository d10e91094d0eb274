"""frames.jsonl: a user's own recording with poses, boxes and LiDAR, every number worked out by hand."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from own_folder import CAR, QUARTER_TURN, RIG, line, write_folder

from coin3d.datasets.open import open_recording
from coin3d.datasets.own_recording import OwnRecording


def test_a_line_with_images_alone_is_a_frame(tmp_path: Path) -> None:
    recording = open_recording(write_folder(tmp_path / "van", line(0), line(1)), undistort=False)
    assert isinstance(recording, OwnRecording) and len(recording) == 2
    frame = recording[0]
    assert (frame.token, frame.scene, frame.timestamp_ns, frame.next) == ("f0", "van", 0, "f1")
    assert frame.boxes_world is None and frame.lidar is None and list(frame.rig) == ["left", "right"]
    assert recording[1].image("right")[0, 0].tolist() == [40, 40, 40]
    with pytest.raises(IndexError):
        recording[2]


def test_scenes_come_as_they_appear_and_frames_by_time(tmp_path: Path) -> None:
    lines = [
        line(0, token="late", scene="b", timestamp_s=12.5),
        line(1, token="other", scene="a"),
        line(2, token="early", scene="b", timestamp_s=12),
    ]
    recording = OwnRecording(write_folder(tmp_path, *lines))
    assert [f.token for f in recording] == ["early", "late", "other"]
    assert [f.timestamp_ns for f in recording] == [12_000_000_000, 12_500_000_000, 0]
    assert [(f.previous, f.next) for f in recording] == [("", "late"), ("early", ""), ("", "")]
    assert recording.scene_names() == ["b", "b", "a"]
    assert [f.token for f in open_recording(tmp_path, split=["a"])] == ["other"]


@pytest.mark.parametrize(
    ("key", "value", "time_ns"),
    [
        ("timestamp_ns", 1_600_000_000_123_456_789, 1_600_000_000_123_456_789),
        ("timestamp_us", 1_600_000_000_123_456, 1_600_000_000_123_456_000),
        ("timestamp_us", 5.25, 5250),
        ("timestamp_ms", 1_600_000_000_123, 1_600_000_000_123_000_000),
        ("timestamp_s", 0.1, 100_000_000),
    ],
)
def test_times_in_every_unit(tmp_path: Path, key: str, value: float, time_ns: int) -> None:
    assert OwnRecording(write_folder(tmp_path, line(**{key: value})))[0].timestamp_ns == time_ns


def test_boxes_in_three_frames_are_the_same_box(tmp_path: Path) -> None:
    rig = RIG + "ego_from_vehicle: [[1, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n"
    world = {**CAR, "centre_m": [9.0, 25.0, 1.3], "yaw_rad": 0.25 + np.pi / 2}
    vehicle = {**CAR, "centre_m": [4.5, 1.0, 0.8]}
    lines = [
        line(0, world_from_ego=QUARTER_TURN, boxes_ego=[CAR]),
        line(1, world_from_ego=QUARTER_TURN, boxes_world=[world]),
        line(2, world_from_ego=QUARTER_TURN, boxes_vehicle=[vehicle]),
    ]
    for frame in OwnRecording(write_folder(tmp_path, *lines, rig=rig)):
        assert frame.boxes is not None and frame.boxes_world is not None
        np.testing.assert_allclose(frame.boxes_world.centre_m, [[9.0, 25.0, 1.3]], atol=1e-9)
        np.testing.assert_allclose(frame.boxes.centre_m, [[5.0, 1.0, 0.8]], atol=1e-9)
        np.testing.assert_allclose(frame.boxes.yaw_rad, [0.25], atol=1e-9)
        np.testing.assert_allclose(frame.boxes.size_m, [[4.0, 2.0, 1.6]])


def test_what_a_box_may_say_and_what_is_unknown_otherwise(tmp_path: Path) -> None:
    full = {**CAR, "num_lidar_points": 0, "track": "t7", "velocity_mps": [1.0, -2.0], "visibility": 3}
    boxes = OwnRecording(write_folder(tmp_path, line(boxes_ego=[full, CAR])))[0].boxes
    assert boxes is not None
    assert boxes.visibility.tolist() == [3, 0]
    assert boxes.num_lidar_points.tolist() == [0, -1] and boxes.instance_ids.tolist() == ["t7", ""]
    np.testing.assert_allclose(boxes.velocity_mps[0], [1.0, -2.0])
    assert np.isnan(boxes.velocity_mps[1]).all() and boxes.labels.tolist() == ["car", "car"]
    assert len(OwnRecording(write_folder(tmp_path, line(boxes_ego=[])))[0].boxes) == 0


@pytest.mark.parametrize(
    ("said", "yaw_rad"),
    [
        ({"yaw_deg": 90}, np.pi / 2),
        ({"quaternion_wxyz": [0.5**0.5, 0, 0, -(0.5**0.5)]}, -np.pi / 2),
        ({"yaw_rad": 7.0}, 7 - 2 * np.pi),
    ],
)
def test_three_ways_to_say_where_a_box_points(tmp_path: Path, said: dict[str, Any], yaw_rad: float) -> None:
    box = {**{k: v for k, v in CAR.items() if k != "yaw_rad"}, **said}
    boxes = OwnRecording(write_folder(tmp_path, line(boxes_ego=[box])))[0].boxes
    assert boxes is not None and boxes.yaw_rad[0] == pytest.approx(yaw_rad, abs=1e-9)


def test_a_pose_as_matrix_and_of_a_vehicle_that_is_not_the_ego(tmp_path: Path) -> None:
    rig = RIG + "ego_from_vehicle: [[1, 0, 0, 0.9], [0, 1, 0, 0], [0, 0, 1, 1.8], [0, 0, 0, 1]]\n"
    matrix = [[0, -1, 0, 10], [1, 0, 0, 20], [0, 0, 1, 2.3], [0, 0, 0, 1]]
    frame = OwnRecording(write_folder(tmp_path, line(world_from_vehicle=matrix), rig=rig))[0]
    # the vehicle frame is 0.9 m ahead of the ego frame and 1.8 m above it; ahead is world +y
    np.testing.assert_allclose(frame.world_from_ego.translation, [10, 19.1, 0.5], atol=1e-12)
    assert frame.world_from_ego.yaw_rad == pytest.approx(np.pi / 2)


def test_images_that_say_where_the_vehicle_was(tmp_path: Path) -> None:
    earlier = {**QUARTER_TURN, "translation_m": [10.0, 19.7, 0.5]}
    images = {"left": {"path": "left/0.png", "world_from_ego": earlier}, "right": "right/0.png"}
    frame = OwnRecording(write_folder(tmp_path, line(world_from_ego=QUARTER_TURN, images=images)))[0]
    np.testing.assert_allclose(frame.rig["left"].ego_from_cam.translation, [0.7, 0.4, 1.4], atol=1e-9)
    np.testing.assert_allclose(frame.rig["right"].ego_from_cam.translation, [1.0, -0.4, 1.4], atol=1e-9)


def test_a_frame_may_lack_cameras_or_have_a_rig_of_its_own(tmp_path: Path) -> None:
    root = write_folder(
        tmp_path, line(0, images={"right": "right/0.png"}), line(1, rig="rigs/wide.yaml"), line(2, rig="r.json")
    )
    (root / "rigs").mkdir()
    (root / "rigs" / "wide.yaml").write_text(RIG.replace("focal: 30", "focal: 15"))
    camera = {"size": [40, 30], "focal": 60, "position": [0, 0, 1], "yaw_deg": 0}
    (root / "r.json").write_text(json.dumps({"cameras": {"left": camera, "right": camera}}))
    frames = list(OwnRecording(root))
    assert list(frames[0].rig) == ["right"]
    assert [frame.rig["right"].focal_px for frame in frames] == pytest.approx([30, 15, 60])
    (root / "rig.yaml").unlink()
    with pytest.raises(ValueError, match=r"frames\.jsonl, line 1: names no rig, and there is no .*rig\.yaml"):
        OwnRecording(root)[0]
    assert OwnRecording(root)[1].rig["left"].focal_px == pytest.approx(15)


def test_lidar_lands_in_the_ego_frame(tmp_path: Path) -> None:
    mount = [[0, -1, 0, 0.9], [1, 0, 0, 0], [0, 0, 1, 1.8], [0, 0, 0, 1]]  # the sensor's x looks to the left
    about = {"path": "scan.bin", "columns": ["x", "y", "z", "intensity", "ring"], "vehicle_from_lidar": mount}
    root = write_folder(tmp_path, line(lidar=about))
    np.array([[10, 0, -1.8, 0.25, 3], [np.nan, 0, 0, 0, 0]], dtype="<f4").tofile(root / "scan.bin")
    scan = OwnRecording(root)[0].lidar.load()
    np.testing.assert_allclose(scan.points_ego, [[0.9, 10, 0]], atol=1e-6)
    np.testing.assert_allclose(scan.origin_ego, [0.9, 0, 1.8])
    assert scan.intensity.tolist() == [0.25]


def test_masks_of_the_own_vehicle_and_a_byte_order_mark(tmp_path: Path) -> None:
    import cv2

    root = write_folder(tmp_path, line())
    (root / "frames.jsonl").write_bytes(b"\xef\xbb\xbf\n" + (root / "frames.jsonl").read_bytes())
    mask = np.zeros((30, 40), dtype=np.uint8)
    mask[20:] = 255
    (root / "own_vehicle").mkdir()
    cv2.imwrite(str(root / "own_vehicle" / "left.png"), mask)
    frame = OwnRecording(root)[0]
    assert frame.own_vehicle_mask("left").sum() == 400 and not frame.own_vehicle_mask("right").any()


BAD_LINES: list[tuple[dict[str, Any] | str, str]] = [
    ('{"token": "f0"', "line 2: not JSON"),
    ("[1, 2]", "line 2: an object in braces is expected, got \\[1, 2\\]"),
    (line(0, timestamp_ns=float("nan")), "line 2: not JSON: NaN is no number"),
    ('{"token": "a", "token": "b", "images": {}}', "line 2: not JSON: the key 'token' is there twice"),
    ("[" * 100_000, "line 2: not JSON"),
    (line(0, token=None), "line 2: 'token' is missing"),
    (line(0, token="f1"), "line 2: the token 'f1' stands in line 1 already"),
    (line(0, token="../x"), "line 2: token: a name of 1 to 200 printable characters without slashes"),
    (line(0, token=".."), "line 2: token: '..' is no name"),
    (line(0, scene=7), "line 2: scene: a name of 1 to 200"),
    (line(0, time=7), "line 2: unknown key 'time'; known are token, timestamp_ns"),
    (line(0, boxes_eog=[]), "line 2: unknown key 'boxes_eog'; did you mean boxes_ego\\?"),
    (line(0, timestamp_ns=1.5), "line 2: timestamp_ns is a time"),
    (line(0, timestamp_s=-1), "line 2: timestamp_s: a whole number from 0"),
    (line(0, timestamp_s=1, timestamp_ns=1), "line 2: timestamp_ns and timestamp_s say the same thing"),
    (line(0, timestamp_s=1e11), "line 2: timestamp_s is a time"),
    (line(0, timestamp_s=5), "line 2: 'f.' and 'f.' of scene 'van' have the same time"),
    (line(0, world_from_ego=QUARTER_TURN, world_from_vehicle=QUARTER_TURN), "say the same thing"),
    (line(0, world_from_ego=QUARTER_TURN), "line 1: 'f1' does not say where the vehicle was"),
]  # fmt: skip


@pytest.mark.parametrize(("bad", "message"), BAD_LINES)
def test_lines_that_are_refused_when_the_recording_is_opened(tmp_path: Path, bad: dict[str, Any] | str, message: str) -> None:
    with pytest.raises(ValueError, match=rf"frames\.jsonl, .*{message}"):
        OwnRecording(write_folder(tmp_path / "van", line(1, timestamp_s=5), bad))


BAD_CONTENT: list[tuple[dict[str, Any], str]] = [
    ({"images": {}}, "'images' names a file for each camera"),
    ({"images": {"rear": "left/0.png"}}, "the rig 'rig' has no camera 'rear', only left, right"),
    ({"images": {"left": "../left/0.png"}}, "camera 'left': '../left/0.png' leads out of the recording"),
    ({"images": {"left": "/etc/passwd"}}, "leads out of the recording"),
    ({"images": {"left": "C:\\\\x.png"}}, "leads out of the recording"),
    ({"images": {"left": "a\u0000b"}}, "the name of a file is expected"),
    ({"images": {"left": {"path": "left/0.png", "pose": 1}}}, "camera 'left': unknown key 'pose'"),
    ({"images": {"left": {"path": "left/0.png", "world_from_ego": QUARTER_TURN}}}, "but the frame does not"),
    ({"rig": "../rig.yaml"}, "rig: '../rig.yaml' leads out"),
    ({"rig": "none.yaml"}, "rig 'none.yaml': .*no such rig file"),
    ({"world_from_ego": {"translation_m": [0, 0, 0]}}, "world_from_ego: pose: 'quaternion_wxyz' is missing"),
    ({"world_from_ego": {"translation_m": [0, 0], "quaternion_wxyz": [1, 0, 0, 0]}}, "a list of 3 numbers"),
    ({"world_from_ego": {"translation_m": [0, 0, 0], "quaternion_wxyz": [1, 1, 0, 0]}}, "has length 1"),
    ({"world_from_ego": [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}, "not a rotation matrix"),
    ({"boxes_world": [CAR]}, "boxes_world need to know where the vehicle was"),
    ({"boxes_ego": CAR}, "boxes_ego is a list of boxes"),
    ({"boxes_ego": [CAR, {**CAR, "size": 1}]}, r"boxes_ego\[1\]: unknown key 'size'"),
    ({"boxes_ego": [{**CAR, "width_m": 0}]}, r"boxes_ego\[0\]: length, width and height are positive"),
    ({"boxes_ego": [{**CAR, "width_m": "2"}]}, r"boxes_ego\[0\]: width_m: a number is expected, got '2'"),
    ({"boxes_ego": [{**CAR, "yaw_deg": 3}]}, "yaw_rad and yaw_deg say the same thing"),
    ({"boxes_ego": [{**CAR, "centre_m": [1, 2, 1e300]}]}, "centre_m: a number is expected, got 1e"),
    ({"boxes_ego": [{**CAR, "centre_m": [True, 2, 3]}]}, "centre_m: a number is expected, got True"),
    ({"boxes_ego": [{**CAR, "num_lidar_points": -2}]}, "num_lidar_points: a whole number from -1"),
    ({"boxes_ego": [{**CAR, "num_lidar_points": 10**30}]}, "num_lidar_points: a whole number"),
    ({"boxes_ego": [{**CAR, "visibility": 5}]}, "visibility: a whole number from 0 to 4"),
    ({"boxes_ego": [{**CAR, "visibility": "4"}]}, "visibility: a whole number from 0 to 4"),
    ({"boxes_ego": [], "boxes_world": []}, "boxes_ego and boxes_world say the same thing"),
    ({"lidar": {"path": "a.bin"}}, "lidar: 'vehicle_from_lidar' is missing"),
    ({"lidar": {"path": "a.bin", "vehicle_from_lidar": QUARTER_TURN}}, "'columns' names the numbers of a point"),
    ({"lidar": {"path": "a.bin", "columns": ["x", "y", "y", "z"], "vehicle_from_lidar": QUARTER_TURN}}, "each once"),
    ({"lidar": {"path": "a.las", "columns": ["x", "y", "z"], "vehicle_from_lidar": QUARTER_TURN}}, "end in .bin, .npy, .pcd"),
    ({"lidar": {"path": "../a.bin", "columns": ["x", "y", "z"], "vehicle_from_lidar": QUARTER_TURN}}, "leads out"),
]  # fmt: skip


@pytest.mark.parametrize(("said", "message"), BAD_CONTENT)
def test_content_that_is_refused_when_the_frame_is_read(tmp_path: Path, said: dict[str, Any], message: str) -> None:
    recording = OwnRecording(write_folder(tmp_path, line(**said)))
    with pytest.raises(ValueError, match=rf"frames\.jsonl, line 1.*{message}"):
        recording[0]


def test_no_lines_and_lines_that_change_while_open(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"frames\.jsonl: holds no frames"):
        OwnRecording(write_folder(tmp_path, "", "  "))
    recording = OwnRecording(write_folder(tmp_path, line(0), line(1)))
    write_folder(tmp_path, line(1), line(0))
    with pytest.raises(ValueError, match="line 1: has changed since the recording was opened"):
        recording[0]


@given(st.data())
def test_damaged_lines_end_in_an_error_or_in_frames(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    mount = np.eye(4).tolist()
    whole = json.dumps(
        line(
            world_from_ego=QUARTER_TURN, boxes_world=[CAR], lidar={"path": "a.pcd", "vehicle_from_lidar": mount}, timestamp_s=1
        )
    ).encode()
    root = tmp_path_factory.mktemp("fuzz")
    write_folder(root, line())
    at = data.draw(st.integers(0, len(whole)))
    cut = data.draw(st.integers(0, 3))
    (root / "frames.jsonl").write_bytes(whole[:at] + data.draw(st.binary(max_size=6)) + whole[at + cut :])
    try:
        frames = list(OwnRecording(root))
    except ValueError as error:
        assert "frames.jsonl" in str(error)
    else:
        assert all(frame.boxes is None or np.isfinite(frame.boxes.centre_m).all() for frame in frames)
