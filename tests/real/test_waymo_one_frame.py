"""One real Waymo v1 frame: images, labels, rig, and the boxes that Waymo itself projected into the images."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from coin3d.datasets.classes import THREE_CLASS
from coin3d.datasets.file_span import FileSpan
from coin3d.datasets.frame import Frame
from coin3d.datasets.open import open_recording
from coin3d.datasets.protobuf_wire import Message
from coin3d.datasets.tfrecord import read_payload, record_spans
from coin3d.datasets.waymo_v1 import WaymoV1Recording
from coin3d.geometry import BrownConrady, Pinhole, preset_rig

SIZES = {"FRONT": (1280, 1920), "FRONT_LEFT": (1280, 1920), "FRONT_RIGHT": (1280, 1920)}
SIZES |= {"SIDE_LEFT": (886, 1920), "SIDE_RIGHT": (886, 1920)}


@pytest.fixture
def frame(waymo_one_frame: Path) -> Frame:
    (frame,) = WaymoV1Recording(waymo_one_frame)
    return frame


def test_images_and_labels(frame: Frame) -> None:
    assert {name: frame.image(name).shape[:2] for name in frame.rig} == SIZES
    boxes = frame.boxes
    assert boxes is not None and frame.boxes_world is not None
    assert Counter(boxes.labels.tolist()) == {"VEHICLE": 37, "SIGN": 25, "PEDESTRIAN": 12, "CYCLIST": 1}
    assert Counter(THREE_CLASS.apply(boxes).labels.tolist()) == {"car": 37, "pedestrian": 12, "two-wheel": 1}
    assert len(set(boxes.instance_ids.tolist())) == 75 and (boxes.num_lidar_points >= 0).all()
    assert (frame.scene, frame.timestamp_ns) == ("1024360143612057520_3580_000_3600_000", 1553735853462203000)
    assert frame.lidar is None and (frame.previous, frame.next) == ("", "")


def test_the_rig_is_that_of_the_papers_table(frame: Frame) -> None:
    table = preset_rig("waymo")
    assert list(frame.rig) == list(table)
    for name, camera in frame.rig.items():
        assert camera.focal_px == pytest.approx(table[name].focal_px, rel=0.01)
        assert camera.height_m == pytest.approx(table[name].height_m, abs=0.05)
        np.testing.assert_allclose(camera.ego_from_cam.translation, table[name].ego_from_cam.translation, atol=0.08)
        assert np.cos(camera.yaw_rad - table[name].yaw_rad) > np.cos(np.deg2rad(1.5))
        assert isinstance(camera.lens, BrownConrady)


def test_velocities_point_along_the_boxes(frame: Frame) -> None:
    boxes = frame.boxes_world
    assert boxes is not None
    speed = np.linalg.norm(boxes.velocity_mps, axis=1)
    drives = (speed > 1) & (boxes.labels == "VEHICLE")
    course = np.arctan2(boxes.velocity_mps[drives, 1], boxes.velocity_mps[drives, 0])
    assert drives.sum() == 2 and (np.cos(course - boxes.yaw_rad[drives]) > np.cos(np.deg2rad(3))).all()


def projected_labels(folder: Path) -> dict[tuple[str, str], np.ndarray]:
    """(camera, object) -> left, top, right, bottom of the box as Waymo projects it, rolling shutter included."""
    span: FileSpan = next(record_spans(folder / "frame.tfrecord"))
    found = {}
    for row in Message(read_payload(span), "frame").messages(9, "projected labels"):
        camera = list(SIZES)[(row.whole(1, "camera") or 0) - 1]
        for label in row.messages(2, "label"):
            box = label.message(1, "box")
            assert box is not None
            x, y, tall, wide = (box.real(n, "number") or 0.0 for n in (1, 2, 4, 5))
            name = (label.text(4, "id") or "").removesuffix(f"_{camera}")
            found[camera, name] = np.array([x - wide / 2, y - tall / 2, x + wide / 2, y + tall / 2])
    return found


def edge_errors_px(frame: Frame, theirs: dict[tuple[str, str], np.ndarray], pinhole: bool) -> np.ndarray:
    """Edges of our projected boxes less those of Waymo's, of boxes that are wholly in an image."""
    boxes, errors = frame.boxes, []
    assert boxes is not None
    ids = boxes.instance_ids.tolist()
    for (name, instance), edges in theirs.items():
        camera = frame.rig[name]
        if pinhole:
            camera = type(camera)(camera.K, camera.width_px, camera.height_px, camera.ego_from_cam, Pinhole())
        pixels, depth_m = camera.project(boxes.corners()[ids.index(instance)])
        if not np.isfinite(pixels).all():
            continue  # a corner where the lens formula ends
        left, top = pixels.min(0)
        right, bottom = pixels.max(0)
        if depth_m.min() > 1 and min(left, top) > 2 and right < camera.width_px - 2 and bottom < camera.height_px - 2:
            errors.append(np.array([left, top, right, bottom]) - edges)
    return np.array(errors)


def test_boxes_project_to_where_waymo_projects_them(frame: Frame, waymo_one_frame: Path) -> None:
    theirs = projected_labels(waymo_one_frame)
    errors = edge_errors_px(frame, theirs, pinhole=False)
    assert len(errors) > 30
    assert np.abs(np.median(errors, axis=0)).max() < 0.1, "no shift between their pixels and ours"
    assert np.percentile(np.abs(errors), 90) < 0.5
    without = edge_errors_px(frame, theirs, pinhole=True)
    assert np.percentile(np.abs(without), 90) > 2 * np.percentile(np.abs(errors), 90), "the lens is there for a reason"


def test_scenes_are_known_without_building_frames(waymo_one_frame: Path, frame: Frame) -> None:
    assert open_recording(waymo_one_frame).scene_names() == [frame.scene]
