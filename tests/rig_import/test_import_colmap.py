"""COLMAP models: poses and scale by hand, camera models, and every complaint."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from coin3d.geometry import BrownConrady, Fisheye, Lens, Pinhole
from coin3d.rig_import import Base, import_rig

CAMERAS = "# Camera list\n1 OPENCV 640 480 500 510 320 240 -0.3 0.1 0.001 -0.002\n2 PINHOLE 800 600 700 700 400 300\n"
HALF = np.sqrt(0.5)
# p_cam = R p_world + t. The front camera is the world. The right one sits at x = 2 of it and looks to its right:
# world (x, y, z) -> (-z, y, x - 2), a turn by -90 degrees about y: quaternion (w, y) = (sqrt 1/2, -sqrt 1/2)
IMAGES = f"""\
# Image list with two lines of data per image
1 1 0 0 0 0 0 0 1 front.jpg
10.5 20.5 -1 11.0 12.0 7
2 {HALF} 0 {-HALF} 0 0 0 -2 2 right.jpg

"""
FRONT = Base("front", (1.5, 0, 1.4, 0, 0, 0))


def model(folder: Path, cameras: str = CAMERAS, images: str = IMAGES) -> Path:
    (folder / "cameras.txt").write_text(cameras, encoding="utf-8")
    (folder / "images.txt").write_text(images, encoding="utf-8")
    return folder


def test_two_images_by_hand(tmp_path: Path) -> None:
    rig, remarks = import_rig(model(tmp_path), FRONT, scale=0.25)
    assert list(rig) == ["front", "right"]
    np.testing.assert_allclose(rig["front"].ego_from_cam.translation, [1.5, 0, 1.4])
    # 2 units of 0.25 m to the right
    np.testing.assert_allclose(rig["right"].ego_from_cam.translation, [1.5, -0.5, 1.4], atol=1e-12)
    assert np.rad2deg(rig["right"].yaw_rad) == pytest.approx(-90)
    # COLMAP's pixels start at the corner as ours do
    np.testing.assert_allclose(rig["front"].K, [[500, 0, 320], [0, 510, 240], [0, 0, 1]])
    assert rig["front"].lens == BrownConrady(-0.3, 0.1, 0.001, -0.002) and rig["right"].lens == Pinhole()
    assert (rig["right"].width_px, rig["right"].height_px) == (800, 600)
    assert remarks == ("right: placed relative to front by 1 frame",)


def test_many_frames_and_one_that_went_wrong(tmp_path: Path) -> None:
    # the vehicle drives along the front camera's z; the camera 'left' stays 1 unit to its left; frame 2 is off by 5
    lines, number = [], 0
    for frame in range(5):
        for camera, x in (("front", 0.0), ("left", -1.0)):
            number += 1
            off = 5 if (camera, frame) == ("left", 2) else 0
            lines += [f"{number} 1 0 0 0 {-x + off} 0 {-3.0 * frame} 1 rig/{camera}/{frame:04d}.png", ""]
    lines += [f"{number + 1} 1 0 0 0 0 0 0 1 rig/left/9999.png", ""]  # a frame that the base has not
    rig, remarks = import_rig(model(tmp_path, images="\n".join(lines)), FRONT, scale=0.5)
    np.testing.assert_allclose(rig["left"].ego_from_cam.translation, [1.5, 0.5, 1.4], atol=1e-12)
    assert remarks == ("left: placed relative to front by 5 frames, which differ by up to 2.500 m and 0.00 degrees",)


@pytest.mark.parametrize(
    ("line", "focal", "lens"),
    [
        ("SIMPLE_PINHOLE 640 480 500 320 240", (500, 500), Pinhole()),
        ("SIMPLE_RADIAL 640 480 500 320 240 -0.1", (500, 500), BrownConrady(-0.1, 0, 0, 0)),
        ("RADIAL 640 480 500 320 240 -0.1 0.02", (500, 500), BrownConrady(-0.1, 0.02, 0, 0)),
        ("FULL_OPENCV 640 480 500 510 320 240 1 2 0.01 0.02 3 1 2 3", (500, 510), BrownConrady(1, 2, 0.01, 0.02, 3, 1, 2, 3)),
        ("OPENCV_FISHEYE 640 480 500 510 320 240 0.1 0.02 0.003 0", (500, 510), Fisheye(0.1, 0.02, 0.003, 0)),
        ("SIMPLE_RADIAL_FISHEYE 640 480 500 320 240 0.1", (500, 500), Fisheye(0.1, 0, 0, 0)),
        ("RADIAL_FISHEYE 640 480 500 320 240 0.1 0.02", (500, 500), Fisheye(0.1, 0.02, 0, 0)),
    ],
)
def test_camera_models(tmp_path: Path, line: str, focal: tuple[float, float], lens: Lens) -> None:
    images = "1 1 0 0 0 0 0 0 1 front.jpg\n\n"
    rig, _ = import_rig(model(tmp_path, f"1 {line}\n", images), Base(pose=(1.5, 0, 1.4, 0, 0, 0)))  # one camera: no scale
    np.testing.assert_allclose(rig["front"].K, [[focal[0], 0, 320], [0, focal[1], 240], [0, 0, 1]])
    assert rig["front"].lens == lens


@pytest.mark.parametrize(
    ("cameras", "images", "message"),
    [
        (("OPENCV", "FOV"), None, r"cameras.txt, line 2: the camera model FOV is not supported"),
        ((" -0.002", ""), None, r"cameras.txt, line 2: the camera model OPENCV has 8 parameters, got 7"),
        (("500 510", "nan 510"), None, r"cameras.txt, line 2 holds a number that is not finite"),
        (("500 510", "x 510"), None, r"cameras.txt, line 2: could not convert"),
        (("500 510", "0 510"), None, r"cameras.txt, line 2: a focal length is more than 0"),
        (("640 480", "640 -480"), None, r"cameras.txt, line 2: an image size"),
        (("2 PINHOLE", "1 PINHOLE"), None, r"cameras.txt, line 3: the camera id 1 a second time"),
        (("2 PINHOLE", "3 PINHOLE"), None, r"images of 'right' have the camera ids 2; one of cameras.txt"),
        (("2 PINHOLE 800 600 700 700 400 300", "2 PINHOLE"), None, r"cameras.txt, line 3: CAMERA_ID MODEL"),
        (None, ("1 1 0 0 0", "1 1 1 0 0"), r"images.txt, line 2: a rotation quaternion"),
        (None, ("0 0 0 1 front.jpg", "0 0 front.jpg"), r"images.txt, line 2: IMAGE_ID QW"),
        (None, ("right.jpg", "front.png"), r"images.txt, line 4: a second image of the camera 'front'"),
        (None, ("right.jpg", "right/1.jpg"), r"no frame has images of both 'right' and 'front'"),
        (None, (IMAGES, "# nothing\n"), r"images.txt: no image is registered"),
    ],
)  # fmt: skip
def test_every_complaint_names_the_line(
    tmp_path: Path, cameras: tuple[str, str] | None, images: tuple[str, str] | None, message: str
) -> None:
    texts = [text.replace(*change, 1) if change else text for text, change in ((CAMERAS, cameras), (IMAGES, images))]
    with pytest.raises(ValueError, match=message) as error:
        import_rig(model(tmp_path, *texts), FRONT, scale=1)
    assert str(error.value).startswith(str(tmp_path))


def test_what_the_user_has_to_add(tmp_path: Path) -> None:
    model(tmp_path)
    with pytest.raises(ValueError, match=r"no unit. Add --scale.*it puts 'right' 2 units from 'front'"):
        import_rig(tmp_path, FRONT)
    for scale in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match="--scale is metres per unit"):
            import_rig(tmp_path, FRONT, scale=scale)
    with pytest.raises(ValueError, match="where 'front' sits on the vehicle"):
        import_rig(tmp_path, Base(), scale=1)
    with pytest.raises(ValueError, match="no camera 'rear'; --base is one of front, right"):
        import_rig(tmp_path, Base("rear"), scale=1)


def test_images_that_are_not_sorted_by_camera(tmp_path: Path) -> None:
    images = "".join(f"{i} 1 0 0 0 0 0 0 1 img{i:04d}.jpg\n\n" for i in range(101))
    with pytest.raises(ValueError, match=r"images of 101 cameras .img0000, .*into a folder with its name"):
        import_rig(model(tmp_path, images=images), FRONT, scale=1)


def test_a_binary_model(tmp_path: Path) -> None:
    (tmp_path / "cameras.bin").write_bytes(b"\0" * 8)
    with pytest.raises(ValueError, match="convert a binary model by: colmap model_converter"):
        import_rig(tmp_path, FRONT)
