"""Own images beside a rig.yaml."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from coin3d.datasets.folder import FolderRecording
from coin3d.datasets.nuscenes_format import NuScenesRecording
from coin3d.datasets.open import open_recording

RIG = """
cameras:
  left: {size: [40, 30], focal: 30, position: [1.0, 0.4, 1.4], yaw_deg: 45}
  right: {size: [40, 30], focal: 30, position: [1.0, -0.4, 1.4], yaw_deg: -45}
"""


def _folder(root: Path, *names: str) -> Path:
    root.mkdir(exist_ok=True)
    (root / "rig.yaml").write_text(RIG)
    for name in names:
        (root / name).parent.mkdir(exist_ok=True)
        cv2.imwrite(str(root / name), np.full((30, 40, 3), (200, 0, 0), dtype=np.uint8))
    return root


def test_one_frame(tmp_path: Path) -> None:
    recording = FolderRecording(_folder(tmp_path / "van", "left.png", "right.png", "notes.png"))
    assert len(recording) == 1
    frame = recording[0]
    assert (frame.token, frame.boxes_world, frame.lidar, frame.previous, frame.next) == ("van", None, None, "", "")
    assert list(frame.rig) == ["left", "right"]
    assert frame.image("left")[0, 0].tolist() == [0, 0, 200]


def test_many_frames_in_numeric_order(tmp_path: Path) -> None:
    names = [f"{camera}/{k}.png" for camera in ("left", "right") for k in (1, 2, 10)]
    recording = FolderRecording(_folder(tmp_path / "van", *names))
    assert [frame.token for frame in recording] == ["1", "2", "10"]
    assert (recording[1].previous, recording[1].next) == ("1", "10")
    assert (recording[-1].previous, recording[-1].next) == ("2", "")
    assert recording[2].images["right"] == tmp_path / "van/right/10.png"
    with pytest.raises(IndexError):
        recording[3]


def test_cameras_must_have_the_same_frames(tmp_path: Path) -> None:
    root = _folder(tmp_path / "van", "left/1.png", "left/2.png", "right/2.png")
    with pytest.raises(ValueError, match=r"camera 'right' lacks the frames 1 that other cameras have; add right/1\.jpg"):
        FolderRecording(root)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("left.png",), "no images of the cameras right"),
        ((), "no images of the cameras left, right"),
        (("left/1.png", "left/1.jpg", "right/1.png"), "both 1.jpg and 1.png"),
        (("left/readme.txt.bmp",), "hold no images"),
    ],
)
def test_missing_or_doubled_images(tmp_path: Path, names: tuple[str, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        FolderRecording(_folder(tmp_path / "van", *names))


def test_image_size_that_contradicts_the_rig(tmp_path: Path) -> None:
    root = _folder(tmp_path / "van", "left.png", "right.png")
    cv2.imwrite(str(root / "left.png"), np.zeros((15, 20, 3), dtype=np.uint8))
    with pytest.raises(ValueError, match=r"left: the image .*left\.png is 20 x 15 pixels but the rig says 40 x 30"):
        FolderRecording(root)[0].image("left")


@pytest.mark.parametrize(
    ("rig", "message"),
    [
        ("cameras: {}", "holds 'cameras:'"),
        ("cameras: {a: {size: [4, 4], focal: .nan, position: [0, 0, 1], yaw_deg: 0}}", "camera 'a'.*not finite"),
        (
            "cameras: {a: {size: [4, 4], focal: 3, vehicle_from_cam: [[2,0,0,0],[0,1,0,0],[0,0,1,1],[0,0,0,1]]}}",
            "camera 'a'.*not a rotation matrix",
        ),
    ],
)
def test_rig_files_that_make_no_sense(tmp_path: Path, rig: str, message: str) -> None:
    root = _folder(tmp_path / "van", "a.png")
    (root / "rig.yaml").write_text(rig)
    with pytest.raises(ValueError, match=rf"rig\.yaml: .*{message}"):
        open_recording(root)


def test_open_guesses_the_format(tmp_path: Path, tiny_recording: Path) -> None:
    assert isinstance(open_recording(tiny_recording), NuScenesRecording)
    assert isinstance(open_recording(_folder(tmp_path / "van", "left.png", "right.png")), FolderRecording)
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match=r"looked for rig\.yaml .* and for \*/sample\.json"):
        open_recording(tmp_path / "empty")
    with pytest.raises(FileNotFoundError, match="no such folder"):
        open_recording(tmp_path / "nowhere")
