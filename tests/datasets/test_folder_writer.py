"""Any recording, written as a user's own folder, reads back to the same frames."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from coin3d.datasets.folder_writer import write_folder_recording
from coin3d.datasets.frame import Frame, LidarScan, Recording
from coin3d.datasets.open import open_recording
from coin3d.datasets.own_recording import OwnRecording
from coin3d.geometry import Boxes3D, Camera, Pose, Rig, camera_pose


class Sweep:
    """LiDAR that no file holds."""

    def load(self) -> LidarScan:
        return LidarScan(np.array([[12.3, -45.6, 0.7], [-80.1, 3.3, 5.5]]), np.array([0.5, 7.0]), np.array([0.9, 0.1, 1.8]))


def assert_same(written: Frame, read: Frame) -> None:
    for name in ("token", "timestamp_ns", "scene", "previous", "next"):
        assert getattr(read, name) == getattr(written, name), name
    assert read.world_from_ego.allclose(written.world_from_ego, 1e-12)
    assert list(read.rig) == list(written.rig) and read.rig.name == written.rig.name
    for name, camera in written.rig.items():
        np.testing.assert_array_equal(read.rig[name].K, camera.K)
        assert read.rig[name].ego_from_cam.allclose(camera.ego_from_cam, 1e-12)
        np.testing.assert_array_equal(read.image(name), written.image(name))
        np.testing.assert_array_equal(read.own_vehicle_mask(name), written.own_vehicle_mask(name))
    assert (read.boxes_world is None) == (written.boxes_world is None)
    if written.boxes_world is not None and read.boxes_world is not None:
        for name, there in vars(written.boxes_world).items():
            np.testing.assert_array_equal(getattr(read.boxes_world, name), there, name)
    assert (read.lidar is None) == (written.lidar is None)
    if written.lidar is not None and read.lidar is not None:
        scan, back = written.lidar.load(), read.lidar.load()
        np.testing.assert_allclose(back.points_ego, scan.points_ego, atol=1e-5)
        np.testing.assert_allclose(back.intensity, scan.intensity, atol=1e-6)
        np.testing.assert_allclose(back.origin_ego, scan.origin_ego, atol=1e-12)


def assert_round_trip(recording: Recording, root: Path) -> OwnRecording:
    assert write_folder_recording(recording, root) == len(recording)
    back = open_recording(root, undistort=False)
    assert isinstance(back, OwnRecording)
    for written, read in zip(recording, back, strict=True):
        assert_same(written, read)
    return back


def test_a_recording_in_nuscenes_format(tiny_recording: Path, tmp_path: Path) -> None:
    mask = np.zeros((64, 96), dtype=np.uint8)
    mask[50:] = 1
    (tiny_recording / "own_vehicle").mkdir()
    cv2.imwrite(str(tiny_recording / "own_vehicle" / "CAM_BACK.png"), mask)
    assert_round_trip(open_recording(tiny_recording), tmp_path / "copy")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["copy", "tiny"], "nothing is left beside"


def test_a_copy_of_a_copy_and_a_vehicle_frame_of_its_own(tiny_recording: Path, tmp_path: Path) -> None:
    elsewhere = Pose.from_euler(0.1, 0.0, 0.02, [0.9, 0.0, 1.8])
    frames = [replace(f, rig=replace(f.rig, ego_from_vehicle=elsewhere)) for f in open_recording(tiny_recording)]
    write_folder_recording(frames, tmp_path / "one")
    again = open_recording(tmp_path / "one")
    for written, read in zip(frames, again, strict=True):
        assert_same(written, read)
        assert read.rig.ego_from_vehicle.allclose(elsewhere, 1e-12)
    assert_round_trip(again, tmp_path / "two")


def test_images_in_memory_no_labels_and_a_camera_less(tmp_path: Path) -> None:
    pixels = {name: np.random.default_rng(i).integers(0, 256, (30, 40, 3), dtype=np.uint8) for i, name in enumerate(("a", "b"))}
    K = np.array([[30.0, 0, 20.25], [0, 31, 14], [0, 0, 1]])
    rig = Rig({name: Camera(K, 40, 30, camera_pose((1, 0, 1.5), i)) for i, name in enumerate(pixels)}, name="bench")
    eye = {"a": rig["a"]}
    frames = [
        Frame("one", 1, rig, pixels, scene="street", next="two", lidar=Sweep()),
        Frame("two", 5, rig.with_cameras(eye), {"a": pixels["a"]}, scene="street", previous="one", next="three"),
        Frame(
            "three", 9, rig.with_cameras(eye), {"a": pixels["b"]}, boxes_world=Boxes3D.empty(), scene="street", previous="two"
        ),
    ]
    write_folder_recording(frames, tmp_path / "out")
    for written, read in zip(frames, open_recording(tmp_path / "out"), strict=True):
        assert_same(written, read)
    assert (tmp_path / "out/images/a/two.png").is_file()
    assert [p.name for p in (tmp_path / "out/rigs").iterdir()] == ["two.json"], "frames of one rig share its file"


def test_nothing_is_left_after_an_error_and_nothing_is_overwritten(tiny_recording: Path, tmp_path: Path) -> None:
    frames = list(open_recording(tiny_recording))
    out = tmp_path / "out"
    with pytest.raises(ValueError, match="frame a/b: a name of 1 to 200 printable"):
        write_folder_recording([frames[0], replace(frames[1], token="a/b")], out)
    with pytest.raises(ValueError, match="no frames to write"):
        write_folder_recording([], out)
    (tiny_recording / "samples/CAM_FRONT/0_1.jpg").unlink()
    with pytest.raises(ValueError, match=r"0_1\.jpg: the image file is missing"):
        write_folder_recording(frames, out)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["tiny"]
    out.mkdir()
    write_folder_recording(frames[:1], out)
    with pytest.raises(FileExistsError, match="choose another"):
        write_folder_recording(frames[:1], out)
