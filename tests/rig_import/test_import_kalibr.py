"""Kalibr chains: poses by hand, lenses, and every complaint."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from coin3d.geometry import BrownConrady, Fisheye, Pinhole
from coin3d.rig_import import Base, import_rig

# cam1 sits 0.5 m to the right of cam0 and looks the same way: its coordinates are those of cam0 less 0.5 in x.
# cam2 sits 1 m behind cam1 and looks to its right: a point ahead of cam1 (z) is to the left of cam2 (-x).
CHAIN = """
cam0:
  camera_model: pinhole
  intrinsics: [461.6, 460.1, 362.7, 246.0]
  distortion_model: radtan
  distortion_coeffs: [-0.28, 0.07, 0.0009, 0.0001]
  T_cam_imu: [[0, -1, 0, 0.02], [0, 0, -1, 0.03], [1, 0, 0, -0.1], [0, 0, 0, 1]]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  camera_model: pinhole
  intrinsics: [300, 301, 320, 240]
  distortion_model: equidistant
  distortion_coeffs: [-0.01, 0.05, -0.04, 0.01]
  T_cn_cnm1: [[1, 0, 0, -0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
  resolution: [640, 480]
cam2:
  camera_model: pinhole
  intrinsics: [300, 301, 320, 240]
  distortion_model: none
  distortion_coeffs: []
  T_cn_cnm1: [[0, 0, -1, -1], [0, 1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1]]
  resolution: [640, 480]
"""
FRONT = Base(pose=(1.8, 0.1, 1.4, 0, 0, 0))


def write(folder: Path, text: str) -> Path:
    path = folder / "camchain.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_chain_by_hand(tmp_path: Path) -> None:
    rig, remarks = import_rig(write(tmp_path, CHAIN), FRONT)
    assert list(rig) == ["cam0", "cam1", "cam2"] and "rename" in remarks[0] and rig.name == "camchain"
    np.testing.assert_allclose(rig["cam0"].ego_from_cam.translation, [1.8, 0.1, 1.4])
    np.testing.assert_allclose(rig["cam1"].ego_from_cam.translation, [1.8, -0.4, 1.4])
    # T_c2_c1 p = (-z - 1, y, x): its centre, where that is 0, is z = -1 of cam1
    np.testing.assert_allclose(rig["cam2"].ego_from_cam.translation, [0.8, -0.4, 1.4])
    assert np.rad2deg([c.yaw_rad for c in rig.values()]) == pytest.approx([0, 0, -90])
    # OpenCV's pixel centres lie at whole numbers, ours at halves
    np.testing.assert_allclose(rig["cam0"].K, [[461.6, 0, 363.2], [0, 460.1, 246.5], [0, 0, 1]])
    assert [c.lens for c in rig.values()] == [
        BrownConrady(-0.28, 0.07, 0.0009, 0.0001), Fisheye(-0.01, 0.05, -0.04, 0.01), Pinhole(),
    ]  # fmt: skip
    assert (rig["cam0"].width_px, rig["cam0"].height_px) == (752, 480)


def test_another_camera_as_base(tmp_path: Path) -> None:
    rig, _ = import_rig(write(tmp_path, CHAIN), Base("cam2", (0.8, -0.4, 1.4, -90, 0, 0)))
    np.testing.assert_allclose(rig["cam0"].ego_from_cam.translation, [1.8, 0.1, 1.4], atol=1e-12)
    assert rig["cam0"].yaw_rad == pytest.approx(0)


def test_the_imu_as_base(tmp_path: Path) -> None:
    # p_cam0 = (-y + 0.02, -z + 0.03, x - 0.1): the camera sits at x = 0.1, y = 0.02, z = 0.03 of the IMU and looks along x
    rig, _ = import_rig(write(tmp_path, CHAIN), Base("imu", (1, 0, 1, 0, 0, 0)))
    np.testing.assert_allclose(rig["cam0"].ego_from_cam.translation, [1.1, 0.02, 1.03])
    np.testing.assert_allclose(rig["cam1"].ego_from_cam.translation, [1.1, -0.48, 1.03])
    np.testing.assert_allclose(rig.ego_from_vehicle.translation, [1, 0, 1])  # results can be given in the IMU's frame
    turned, _ = import_rig(
        write(tmp_path, CHAIN), Base("imu", matrix=np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]]))
    )
    np.testing.assert_allclose(turned["cam0"].ego_from_cam.translation, [-0.02, 0.1, 2.03])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("camera_model: pinhole", "camera_model: omni"), "cam0: the camera model 'omni'"),
        (("radtan", "fov"), "cam0: the distortion model 'fov' is not supported"),
        (("[461.6, 460.1, 362.7, 246.0]", "[461.6, 460.1, 362.7]"), "cam0: intrinsics holds 4 numbers, got 3"),
        (("461.6", ".nan"), "cam0: intrinsics holds a number that is not finite"),
        (("461.6", "true"), "cam0: intrinsics is a list of numbers"),
        (("461.6", "0"), "cam0: K is singular"),
        (("[-0.28, 0.07, 0.0009, 0.0001]", "[-0.28, 0.07]"), "cam0: distortion_coeffs holds 4 numbers"),
        (("[752, 480]", "[752, 480, 3]"), "cam0: resolution is .width, height."),
        (("[752, 480]", "[752, 0]"), "cam0: resolution: an image size"),
        (("[752, 480]", "[1000000000, 480]"), "cam0: resolution: an image size"),
        (("T_cn_cnm1: [[1, 0", "T_cn_cnm1: [[2, 0"), "cam1: T_cn_cnm1: not a rotation"),
        (("T_cn_cnm1: [[1, 0, 0, -0.5], ", "T_cn_cnm1: ["), "cam1: T_cn_cnm1 is a 4 x 4 matrix"),
        (("  T_cn_cnm1: [[1, 0, 0, -0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n", ""), "cam1: 'T_cn_cnm1' is missing"),
        (("cam1:", "cam7:"), "without a gap, got cam0, cam2, cam7"),
        (("cam2:\n", "cam2: 3\nother:\n"), "cam2: 'T_cn_cnm1' is missing"),
    ],
)  # fmt: skip
def test_every_complaint_names_the_camera(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    assert change[0] in CHAIN
    path = write(tmp_path, CHAIN.replace(*change, 1))
    with pytest.raises(ValueError, match=message) as error:
        import_rig(path, FRONT)
    assert str(error.value).startswith(str(path))


def test_complaints_about_the_base(tmp_path: Path) -> None:
    path = write(tmp_path, CHAIN)
    with pytest.raises(ValueError, match=r"where 'cam0' sits on the vehicle: add --base-pose .* the direction it looks in"):
        import_rig(path, Base())
    with pytest.raises(ValueError, match="no frame 'cam9'; --base is one of cam0, cam1, cam2, or imu"):
        import_rig(path, Base("cam9", (0, 0, 1, 0, 0, 0)))
    with pytest.raises(ValueError, match=r"at or below the ground.*--base-pose says where 'cam0' is"):
        import_rig(path, Base(pose=(0, 0, -1, 0, 0, 0)))
    with pytest.raises(ValueError, match="no camera has 'T_cam_imu'"):
        import_rig(write(tmp_path, CHAIN.replace("T_cam_imu", "T_other")), Base("imu", (0, 0, 1, 0, 0, 0)))
    with pytest.raises(ValueError, match="not by both"):
        Base(pose=(0, 0, 1, 0, 0, 0), matrix=np.eye(4))
    with pytest.raises(ValueError, match="not finite"):
        Base(pose=(0, 0, np.nan, 0, 0, 0))


def test_options_of_other_formats_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path, CHAIN)
    with pytest.raises(ValueError, match="--scale is for COLMAP"):
        import_rig(path, FRONT, scale=2)
    with pytest.raises(ValueError, match="--rectified are for ROS"):
        import_rig(path, FRONT, rectified=True)
    with pytest.raises(FileNotFoundError, match="no such file or folder"):
        import_rig(tmp_path / "nowhere", FRONT)


@pytest.mark.parametrize(
    "content", [b"[" * 50000, b"\xff\xfe\x00", b"cam0: [", b"", b"3", b"&a [*a, *a]", b"cam0: " + b"9" * 5000]
)
def test_files_that_are_no_calibration(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "camchain.yaml"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"camchain\.yaml"):
        import_rig(path, FRONT)


def test_an_endless_file_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "camchain.yaml"
    path.write_bytes(b"#" * (2 * 2**20))
    with pytest.raises(ValueError, match="too large for a calibration"):
        import_rig(path, FRONT)
