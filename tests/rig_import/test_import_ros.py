"""ROS dumps: frames chained by hand, both spellings of CameraInfo, the optical convention, and every complaint."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from coin3d.geometry import BrownConrady, Fisheye, Pinhole
from coin3d.rig_import import Base, import_rig

HALF = np.sqrt(0.5)
# body to optical axes, as every robot description has it: x right is -y, y down is -z, z forward is x
OPTICAL = "x: -0.5, y: 0.5, z: -0.5, w: 0.5"


def transform(parent: str, child: str, xyz: tuple[float, float, float], rotation: str = "x: 0, y: 0, z: 0, w: 1") -> str:
    x, y, z = xyz
    return (
        f"- header: {{stamp: {{sec: 1, nanosec: 2}}, frame_id: {parent}}}\n  child_frame_id: {child}\n"
        f"  transform: {{translation: {{x: {x}, y: {y}, z: {z}}}, rotation: {{{rotation}}}}}\n"
    )


# base_link -> mast (0.5 m ahead, 1.2 m up) -> left_camera (0.3 m to the left, turned left by 90 degrees) -> optical frame
TF = (
    "transforms:\n"
    + transform("base_link", "mast", (0.5, 0, 1.2))
    + transform("mast", "left_camera", (0, 0.3, 0), f"x: 0, y: 0, z: {HALF}, w: {HALF}")
    + "---\ntransforms:\n"
    + transform("left_camera", "left_camera_optical_frame", (0.1, 0, 0), OPTICAL)
    + transform("mast", "/front_optical_frame", (0.4, 0, 0.1), OPTICAL)
    + "---\n"
)
ROS1 = """\
header: {seq: 7, stamp: {secs: 1, nsecs: 2}, frame_id: front_optical_frame}
height: 480
width: 640
distortion_model: plumb_bob
D: [-0.3, 0.1, 0.001, -0.002, 0.01]
K: [500.0, 0.0, 319.5, 0.0, 510.0, 239.5, 0.0, 0.0, 1.0]
R: [1, 0, 0, 0, 1, 0, 0, 0, 1]
P: [450.0, 0, 310.0, 0, 0, 460.0, 230.0, 0, 0, 0, 1, 0]
binning_x: 0
binning_y: 0
roi: {x_offset: 0, y_offset: 0, height: 0, width: 0, do_rectify: false}
---
"""
ROS2 = """\
header:
  stamp: {sec: 1, nanosec: 2}
  frame_id: left_camera_optical_frame
height: 960
width: 1280
distortion_model: equidistant
d: [0.1, -0.02, 0.003, -0.0004]
k: [400.0, 0.0, 639.5, 0.0, 401.0, 479.5, 0.0, 0.0, 1.0]
r: [1, 0, 0, 0, 1, 0, 0, 0, 1]
p: [400.0, 0, 639.5, 0, 0, 401.0, 479.5, 0, 0, 0, 1, 0]
binning_x: 0
binning_y: 0
---
"""


def dumps(folder: Path, **files: str) -> Path:
    for name, text in {"tf_static": TF, "front": ROS1, "left": ROS2, **files}.items():
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    return folder


def test_frames_are_chained_by_hand(tmp_path: Path) -> None:
    rig, remarks = import_rig(dumps(tmp_path), Base())
    assert list(rig) == ["front", "left"]
    np.testing.assert_allclose(rig["front"].ego_from_cam.translation, [0.9, 0, 1.3], atol=1e-12)
    # the last 0.1 m go along the x of left_camera, which points left
    np.testing.assert_allclose(rig["left"].ego_from_cam.translation, [0.5, 0.4, 1.2], atol=1e-12)
    assert np.rad2deg([rig["front"].yaw_rad, rig["left"].yaw_rad]) == pytest.approx([0, 90])
    np.testing.assert_allclose(rig["left"].ego_from_cam.rotation[:, 1], [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(rig["front"].K, [[500, 0, 320], [0, 510, 240], [0, 0, 1]])
    assert rig["front"].lens == BrownConrady(-0.3, 0.1, 0.001, -0.002, 0.01)
    assert rig["left"].lens == Fisheye(0.1, -0.02, 0.003, -0.0004)
    assert (rig["left"].width_px, rig["left"].height_px) == (1280, 960)
    assert "image_raw" in remarks[0] and "base_link" in remarks[1]


def test_a_base_above_the_ground(tmp_path: Path) -> None:
    rig, _ = import_rig(dumps(tmp_path), Base(pose=(0.2, 0, 0.35, 0, 0, 0)))
    np.testing.assert_allclose(rig["front"].ego_from_cam.translation, [1.1, 0, 1.65], atol=1e-12)
    np.testing.assert_allclose(rig.ego_from_vehicle.translation, [0.2, 0, 0.35])
    rig, _ = import_rig(tmp_path, Base("mast", (0.5, 0, 1.2, 0, 0, 0)))
    np.testing.assert_allclose(rig["front"].ego_from_cam.translation, [0.9, 0, 1.3], atol=1e-12)


def test_rectified_images(tmp_path: Path) -> None:
    # R turns camera axes to rectified ones: here by 90 degrees about the optical axis, x_rect = y_cam
    turned = ROS1.replace("R: [1, 0, 0, 0, 1, 0, 0, 0, 1]", "R: [0, 1, 0, -1, 0, 0, 0, 0, 1]")
    rig, _ = import_rig(dumps(tmp_path, front=turned), Base(), rectified=True)
    np.testing.assert_allclose(rig["front"].K, [[450, 0, 310.5], [0, 460, 230.5], [0, 0, 1]])
    assert rig["front"].lens == Pinhole()
    np.testing.assert_allclose(rig["front"].ego_from_cam.rotation[:, 0], [0, 0, -1], atol=1e-12)  # x_rect points down


def test_one_file_with_everything(tmp_path: Path) -> None:
    path = tmp_path / "all.yaml"
    path.write_text(TF + ROS1 + ROS2 + ROS1.replace("secs: 1", "secs: 2"), encoding="utf-8")
    rig, _ = import_rig(path, Base())
    assert list(rig) == ["front", "left_camera"]  # by their frames


@pytest.mark.parametrize(
    ("model", "coefficients", "lens"),
    [
        ("plumb_bob", "[0, 0, 0, 0, 0]", Pinhole()),
        ("plumb_bob", "[]", Pinhole()),
        ("rational_polynomial", "[1, 2, 0, 0, 3, 1, 2, 3]", BrownConrady(1, 2, 0, 0, 3, 1, 2, 3)),
        ("rational_polynomial", "[1, 2, 0, 0, 3, 1, 2, 3, 0, 0, 0, 0, 0, 0]", BrownConrady(1, 2, 0, 0, 3, 1, 2, 3)),
    ],
)
def test_distortion_models(tmp_path: Path, model: str, coefficients: str, lens: object) -> None:
    text = ROS1.replace("plumb_bob", model).replace("[-0.3, 0.1, 0.001, -0.002, 0.01]", coefficients)
    assert import_rig(dumps(tmp_path, front=text), Base())[0]["front"].lens == lens


def test_frames_with_x_forward(tmp_path: Path) -> None:
    body = ROS1.replace("front_optical_frame", "mast")
    with pytest.raises(ValueError, match="camera 'front': the frame 'mast' has x forward, it seems"):
        import_rig(dumps(tmp_path, front=body, left=""), Base())
    rig, _ = import_rig(tmp_path, Base(), camera_axes="x-forward")
    assert rig["front"].yaw_rad == pytest.approx(0)
    np.testing.assert_allclose(rig["front"].ego_from_cam.rotation[:, 1], [0, 0, -1], atol=1e-12)
    up, _ = import_rig(tmp_path, Base(), camera_axes="optical")
    np.testing.assert_allclose(up["front"].ego_from_cam.rotation[:, 2], [0, 0, 1], atol=1e-12)


@pytest.mark.parametrize(
    ("file", "change", "message"),
    [
        ("tf_static", ("frame_id: base_link", "frame_id: odom"), "no frame 'base_link' in the tf messages"),
        ("tf_static", ("frame_id: mast}\n  child_frame_id: /front", "frame_id: pole}\n  child_frame_id: /front"),
         "no transform links 'front_optical_frame' to 'base_link': from 'front_optical_frame' the tree ends at 'pole'"),
        ("tf_static", ("frame_id: base_link", "frame_id: left_camera_optical_frame"), "runs in a loop: "),
        ("tf_static", ("child_frame_id: /front_optical", "child_frame_id: mast\n  x: /front_optical"), "two parents"),
        ("tf_static", ("w: 1}", "w: 3}"), "transform 1: a rotation quaternion"),
        ("tf_static", ("{x: 0.5, y: 0, z: 1.2}", "{x: 0.5, y: 0}"), "transform 1: 'z' is missing"),
        ("tf_static", ("{x: 0.5, y", "{x: .inf, y"), "transform 1: translation holds a number that is not finite"),
        ("tf_static", ("transforms:\n", "transforms: 3\nrest:\n"), "'transforms' is a list"),
        ("tf_static", (TF, ""), "no frame 'front_optical_frame' in the tf messages, only none"),
        ("front", ("K: [500.0", "K: [0.0"), "focal length is 0: this camera was never calibrated"),
        ("front", ("K: [500.0, ", "K: ["), "K holds 9 numbers, got 8"),
        ("front", ("frame_id: front_optical_frame", "frame_id: ''"), "frame_id is empty"),
        ("front", ("width: 640", "width: -640"), "an image size"),
        ("front", ("plumb_bob", "ftheta"), "the distortion model 'ftheta' is not supported"),
        ("front", ("-0.002, 0.01]", "-0.002, 0.01, 7]"), "6 coefficients do not fit the distortion model plumb_bob"),
        ("front", ("plumb_bob", "equidistant"), "a fisheye has 4 coefficients, got 5"),
        ("front", ("binning_x: 0", "binning_x: 2"), "binning or a region of interest"),
        ("front", ("x_offset: 0", "x_offset: 8"), "binning or a region of interest"),
        ("left", ("left_camera_optical_frame", "rear_optical_frame"), "no frame 'rear_optical_frame' in the tf"),
    ],
)  # fmt: skip
def test_every_complaint_names_the_place(tmp_path: Path, file: str, change: tuple[str, str], message: str) -> None:
    text = {"tf_static": TF, "front": ROS1, "left": ROS2}[file]
    assert change[0] in text
    with pytest.raises(ValueError, match=message) as error:
        import_rig(dumps(tmp_path, **{file: text.replace(*change, 1)}), Base())
    assert str(tmp_path) in str(error.value)


def test_a_loop_and_a_moving_link(tmp_path: Path) -> None:
    loop = "transforms:\n" + transform("a", "b", (0, 0, 1)) + transform("b", "a", (0, 0, 1))
    with pytest.raises(ValueError, match=r"runs in a loop: a -> b -> a|runs in a loop: b -> a -> b"):
        import_rig(dumps(tmp_path, more=loop, front=ROS1.replace("front_optical_frame", "a")), Base())
    moving = "transforms:\n" + transform("base_link", "mast", (0.6, 0, 1.2))
    with pytest.raises(ValueError, match="the link from 'base_link' to 'mast' moves"):
        import_rig(dumps(tmp_path, more=moving, front=ROS1), Base())
    outside = "transforms:\n" + transform("odom", "base_link", (1, 0, 0)) + transform("odom", "base_link", (2, 0, 0))
    assert len(import_rig(dumps(tmp_path, more=outside), Base())[0]) == 2  # what moves outside the rig does not matter


def test_two_calibrations_of_a_camera(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"contradicts .*document 1, another calibration of the same name"):
        import_rig(dumps(tmp_path, front=ROS1 + ROS1.replace("500.0", "501.0")), Base())


def test_folders_without_a_calibration(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="holds 0 YAML files"):
        import_rig(tmp_path, Base())
    (tmp_path / "ost.yaml").write_text("image_width: 640\ncamera_matrix: {rows: 3}\n", encoding="utf-8")
    with pytest.raises(ValueError, match="without the camera's frame; record the topic"):
        import_rig(tmp_path, Base())
    (tmp_path / "ost.yaml").write_text("a: 3\n", encoding="utf-8")
    with pytest.raises(ValueError, match="no Kalibr chain, no COLMAP model, and no ROS CameraInfo"):
        import_rig(tmp_path, Base())
