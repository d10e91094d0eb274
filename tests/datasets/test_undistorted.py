"""Frames and recordings with lenses: what comes out, lazily, and what is left alone."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from coin3d.datasets.folder import FolderRecording
from coin3d.datasets.frame import Frame, Recording
from coin3d.datasets.image_source import LazyImage
from coin3d.datasets.open import open_recording
from coin3d.datasets.undistorted import UndistortedImage, UndistortedRecording, undistorted
from coin3d.detectors import frame_sample
from coin3d.detectors.inputs import collate
from coin3d.drawing.pictures import draw_boxes, draw_ground
from coin3d.drawing.top_view import top_view
from coin3d.geometry import Boxes3D, BrownConrady, Fisheye, Pinhole, Rig, save_rig
from coin3d.geometry.undistort import pinhole_camera, undistort_image
from small_world import ring_rig

BARREL = BrownConrady(-0.3, 0.1, 0.001, 0)


def bent_rig() -> Rig:
    rig = ring_rig(3)
    lenses = (BARREL, Pinhole(), Fisheye(0, 0, 0, 0))
    return rig.with_cameras({name: replace(c, lens=lens) for (name, c), lens in zip(rig.items(), lenses, strict=True)})


def pictures(rig: Rig) -> dict[str, np.ndarray]:
    random = np.random.default_rng(0)
    return {name: random.integers(0, 256, (c.height_px, c.width_px, 3), dtype=np.uint8) for name, c in rig.items()}


def test_a_frame_without_lenses_is_the_same_object() -> None:
    rig = ring_rig(2)
    frame = Frame("a", 0, rig, pictures(rig))
    assert undistorted(frame) is frame


def test_a_frame_with_lenses() -> None:
    rig = bent_rig()
    images = pictures(rig)
    frame = Frame("a", 0, rig, images, previous="b")
    straight = undistorted(frame)
    bent, plain, fish = rig
    assert all(isinstance(c.lens, Pinhole) for c in straight.rig.values()) and straight.previous == "b"
    np.testing.assert_array_equal(straight.rig[bent].K, pinhole_camera(rig[bent]).K)
    assert straight.rig[plain] is rig[plain] and straight.images[plain] is images[plain]
    for name in (bent, fish):
        np.testing.assert_array_equal(straight.image(name), undistort_image(images[name], rig[name]))
        assert (straight.image(name) != images[name]).any()
    assert len(collate([frame_sample(straight, 96, 64)]).cameras) == 3
    with pytest.raises(ValueError, match="pinhole cameras only"):
        collate([frame_sample(frame, 96, 64)])


def test_images_are_read_when_asked_for(tmp_path: Path) -> None:
    rig = bent_rig()
    name = next(iter(rig))
    frame = undistorted(Frame("a", 0, rig, {camera: tmp_path / f"{camera}.png" for camera in rig}))
    assert isinstance(frame.images[name], LazyImage) and str(frame.images[name]) == str(tmp_path / f"{name}.png")
    with pytest.raises(ValueError, match=f"{name}.png: the image file is missing"):
        frame.image(name)
    cv2.imwrite(str(tmp_path / f"{name}.png"), np.zeros((10, 20, 3), dtype=np.uint8))
    with pytest.raises(ValueError, match=rf"{name}.png: 20 x 10 pixels but the rig says .*correct 'size'"):
        frame.image(name)


def test_masks_of_the_own_vehicle_follow() -> None:
    rig = bent_rig()
    name = next(iter(rig))
    camera = rig[name]
    mask = np.zeros((camera.height_px, camera.width_px), dtype=np.uint8)
    mask[-camera.height_px // 4 :] = 1
    for source in (mask, np.repeat(mask[..., None], 3, axis=-1)):
        frame = undistorted(Frame("a", 0, rig, pictures(rig), own_vehicle={name: source}))
        found = frame.own_vehicle_mask(name)
        touched = undistort_image(255 * mask, camera) > 0
        np.testing.assert_array_equal(found, touched)
        assert found.any() and not found.all()


def folder(root: Path) -> Path:
    rig = bent_rig()
    root.mkdir()
    save_rig(rig, root / "rig.yaml")
    for name, image in pictures(rig).items():
        cv2.imwrite(str(root / f"{name}.png"), image)
    return root


def test_recordings_come_undistorted_unless_asked_otherwise(tmp_path: Path) -> None:
    root = folder(tmp_path / "van")
    recording = open_recording(root)
    assert isinstance(recording, UndistortedRecording) and isinstance(recording, Recording) and len(recording) == 1
    assert all(isinstance(c.lens, Pinhole) for c in recording[0].rig.values())
    assert [f.token for f in recording] == ["van"] and recording.root == root  # what else the format offers
    with pytest.raises(IndexError):
        recording[1]
    with pytest.raises(AttributeError):
        recording.sweeps  # noqa: B018
    raw = open_recording(root, undistort=False)
    assert isinstance(raw, FolderRecording) and raw[0].rig[next(iter(raw[0].rig))].lens == BARREL
    again = pickle.loads(pickle.dumps(recording))
    name = next(iter(raw[0].rig))
    np.testing.assert_array_equal(again[0].image(name), recording[0].image(name))
    source = again[0].images[name]
    assert isinstance(source, UndistortedImage) and source.camera.lens == BARREL


def test_drawing_through_a_lens_that_ends() -> None:
    """What the model does not describe is left out, and nothing is drawn at random."""
    rig = bent_rig()
    rig = rig.with_cameras({name: replace(c, lens=BrownConrady(-0.3, 0, 0, 0)) for name, c in rig.items()})
    boxes = Boxes3D.create(
        np.array([[8.0, 0, 0.8], [3.0, 6, 0.8], [-5.0, -4, 0.8]]), np.tile([4.0, 2, 1.5], (3, 1)), np.zeros(3), ["car"] * 3
    )
    for name, image in pictures(rig).items():
        drawn = draw_ground(draw_boxes(image, rig[name], boxes), rig[name], rig.ground)
        assert drawn.shape == image.shape
    straight = rig.with_cameras({name: pinhole_camera(c) for name, c in rig.items()})
    np.testing.assert_array_equal(top_view(rig, boxes), top_view(straight, boxes))
