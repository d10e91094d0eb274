"""A DGP recording of two samples written by hand: its poses, boxes, velocities and ground are known numbers."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from coin3d.datasets.classes import MERGED_CAR, PLAIN_CAR, THREE_CLASS
from coin3d.datasets.dgp import DgpRecording
from coin3d.datasets.dgp_files import read_time_ns
from coin3d.datasets.frame import Frame
from coin3d.datasets.open import open_recording

HALF = float(np.sqrt(0.5))
GROUND_M = 0.1
TOUCHES = "2464-11-12T01:04:1{}.000000Z"


def pose(wxyz: tuple[float, ...], xyz: tuple[float, ...]) -> dict[str, Any]:
    axes = zip(("qw", "qx", "qy", "qz"), wxyz, strict=True)
    return {"rotation": dict(axes), "translation": dict(zip("xyz", xyz, strict=True))}


STILL = pose((1, 0, 0, 0), (0, 0, 0))


def write_dgp(root: Path, lidar_mount: tuple[float, float, float] = (0, 0, 0)) -> Path:
    """The vehicle looks along world +y and drives along it: 2 m from the first sample to the second, a second later.

    The camera, 1.5 m ahead and 1.6 m up, fires when the vehicle is 1 m short of where the point cloud is taken. A truck
    stands 8 m ahead and 3 m to the left of the vehicle at both times, so it moves as the vehicle does. A person is in the
    first sample only.
    """
    scene = root / "000001"
    data, samples = [], []
    for k in range(2):
        y = 20.0 + 2 * k
        lidar = pose((HALF, 0, 0, HALF), (10.0 - lidar_mount[1], y + lidar_mount[0], lidar_mount[2]))
        # (yaw 90 degrees) x (optical axes) = (1, -1, 0, 0) / sqrt 2: optical z along world y, optical y along world -z
        camera = pose((HALF, -HALF, 0, 0), (10.0, y - 1 + 1.5, 1.6))
        cloud = {"filename": f"point_cloud/LIDAR/{k}.npz", "point_format": ["X", "Y", "Z", "INTENSITY"], "pose": lidar}
        image = {"filename": f"rgb/CAMERA_01/{k}.jpg", "width": 96, "height": 64, "pose": camera}
        data += [
            _datum(f"l{k}", "LIDAR", k, {"point_cloud": {**cloud, "annotations": {"1": f"bounding_box_3d/LIDAR/{k}.json"}}}),
            _datum(f"c{k}", "CAMERA_01", k, {"image": {**image, "annotations": None}}),
        ]
        samples.append({"calibration_key": "cal", "datum_keys": [f"l{k}", f"c{k}"]})
        _write(scene / f"bounding_box_3d/LIDAR/{k}.json", {"annotations": _boxes(k, lidar_mount)})
        _write_cloud(scene / f"point_cloud/LIDAR/{k}.npz", lidar_mount)
        (scene / "rgb/CAMERA_01").mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(scene / f"rgb/CAMERA_01/{k}.jpg"), np.full((64, 96, 3), 50 + k, np.uint8))
    samples.reverse()  # order in the file means nothing
    _write(scene / "scene_abc.json", {"data": data, "samples": samples, "ontologies": {"1": "names"}})
    intrinsics = [{"fx": 0, "fy": 0, "cx": 0, "cy": 0, "skew": 0}, {"fx": 60, "fy": 61, "cx": 47.5, "cy": 31.5, "skew": 0}]
    mounts = [pose((1, 0, 0, 0), lidar_mount), pose((0.5, -0.5, 0.5, -0.5), (1.5, 0, 1.6))]
    _write(scene / "calibration/cal.json", {"names": ["LIDAR", "CAMERA_01"], "intrinsics": intrinsics, "extrinsics": mounts})
    _write(scene / "ontology/names.json", {"items": [{"id": 0, "name": "Person"}, {"id": 1, "name": "Truck"}]})
    splits = {"0": {"filenames": ["000001/scene_abc.json"]}, "1": {"filenames": ["000001/scene_abc.json"]}}
    _write(root / "ddad.json", {"scene_splits": splits})
    return root


def _datum(key: str, name: str, k: int, content: dict[str, Any]) -> dict[str, Any]:
    return {"key": key, "id": {"name": name, "timestamp": TOUCHES.format(k)}, "datum": content}


def _boxes(k: int, mount: tuple[float, float, float]) -> list[dict[str, Any]]:
    def box(centre: tuple[float, ...], size: tuple[float, ...], class_id: int, name: int, points: int) -> dict[str, Any]:
        turn = (float(np.cos(0.15)), 0.0, 0.0, float(np.sin(0.15)))  # 0.3 rad to the left
        from_lidar = tuple(np.subtract(centre, mount).tolist())
        shape = dict(zip(("length", "width", "height"), size, strict=True))
        return {
            "class_id": class_id,
            "instance_id": name,
            "num_points": points,
            "box": {"pose": pose(turn, from_lidar), **shape},
        }

    truck = box((8, 3, 1), (6, 2, 2), 1, 77, 12)
    return [truck] if k else [truck, box((5, -2, 0.9), (0.6, 0.7, 1.8), 0, 78, 0)]


def _write_cloud(path: Path, mount: tuple[float, float, float]) -> None:
    x, y = np.meshgrid(np.arange(-18, 18.1, 0.4), np.arange(-18, 18.1, 0.4))
    rows = np.stack([x.ravel(), y.ravel(), np.full(x.size, GROUND_M), np.full(x.size, 0.5)], axis=1)
    rows = np.concatenate([[[12.0, 4.0, 3.0, 0.9]], [[np.nan] * 4], rows])
    rows[:, :3] -= mount
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, data=rows)


def _write(path: Path, content: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))


def edit(path: Path, change: Callable[[Any], object]) -> None:
    content = json.loads(path.read_text())
    change(content)
    _write(path, content)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return write_dgp(tmp_path / "ddad")


def frames(root: Path) -> list[Frame]:
    return list(DgpRecording(root))


@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (0.9, 0.2, 1.9)])
def test_poses_boxes_and_ground_are_the_hand_computed_ones(tmp_path: Path, mount: tuple[float, float, float]) -> None:
    first, second = frames(write_dgp(tmp_path / "d", mount))
    assert (first.token, first.previous, first.next, second.previous) == ("l0", "", "l1", "l0")
    assert first.scene == "000001" and second.timestamp_ns - first.timestamp_ns == 1_000_000_000
    np.testing.assert_allclose(first.world_from_ego.translation, (10, 20, 0), atol=1e-12)
    camera = first.rig["CAMERA_01"]
    # mounted 1.5 m ahead, but it fired 1 m short of the reference pose
    np.testing.assert_allclose(camera.ego_from_cam.translation, (0.5, 0, 1.6), atol=1e-12)
    np.testing.assert_allclose(camera.ego_from_cam.rotation, [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], atol=1e-12)
    assert camera.K.tolist() == [[60, 0, 48], [0, 61, 32], [0, 0, 1]]  # half a pixel from OpenCV's origin to ours
    assert first.boxes_world is not None and first.boxes is not None and second.boxes_world is not None
    np.testing.assert_allclose(first.boxes_world.centre_m, [(7, 28, 1), (12, 25, 0.9)], atol=1e-12)
    np.testing.assert_allclose(first.boxes_world.yaw_rad, np.pi / 2 + 0.3)
    np.testing.assert_allclose(first.boxes.centre_m, [(8, 3, 1), (5, -2, 0.9)], atol=1e-12)
    assert first.boxes.size_m.tolist() == [[6, 2, 2], [0.6, 0.7, 1.8]]
    assert first.boxes.labels.tolist() == ["Truck", "Person"] and first.boxes.num_lidar_points.tolist() == [12, 0]
    np.testing.assert_allclose(first.boxes_world.velocity_mps, [(0, 2), (np.nan, np.nan)])
    np.testing.assert_allclose(second.boxes_world.velocity_mps, [(0, 2)])
    assert first.lidar is not None
    scan = first.lidar.load()
    np.testing.assert_allclose(scan.points_ego[0], (12, 4, 3))
    assert scan.intensity[0] == 0.9 and np.isfinite(scan.points_ego).all()
    # a scanner merged into the vehicle frame sits among the cameras, another one where it is mounted
    np.testing.assert_allclose(scan.origin_ego, mount if any(mount) else (1.5, 0, 1.9))
    assert first.rig.ground.height_m(np.array([3.0, 4.0, GROUND_M])) == pytest.approx(0, abs=1e-6)
    assert first.rig.ground is second.rig.ground


def test_it_is_recognised_and_its_classes_have_a_place(root: Path) -> None:
    recording = open_recording(root)
    assert isinstance(recording, DgpRecording) and len(recording) == 2
    assert isinstance(open_recording(root / "000001"), DgpRecording)  # a single scene
    boxes = recording[0].boxes
    assert boxes is not None
    assert THREE_CLASS.apply(boxes).labels.tolist() == ["car", "pedestrian"]
    assert (len(MERGED_CAR.apply(boxes)), len(PLAIN_CAR.apply(boxes))) == (1, 0)
    assert recording[1].image("CAMERA_01").shape == (64, 96, 3)
    assert len(DgpRecording(root, split=1)) == 2
    with pytest.raises(ValueError, match="no split 2, there are 0, 1"):
        DgpRecording(root, split=2)
    with pytest.raises(FileNotFoundError, match="neither a DGP scene list"):
        DgpRecording(root / "000001" / "rgb")


def test_times_of_other_centuries_fit_into_64_bits() -> None:
    then = read_time_ns("2464-11-12T01:04:10.027900Z", "x")
    assert then == read_time_ns("2064-11-12T01:04:10.0279+00:00", "x") < 2**63
    assert read_time_ns("1970-01-02T00:00:00.000001Z", "x") == 86_400_000_001_000
    with pytest.raises(ValueError, match="scene: 'noon' is not a time"):
        read_time_ns("noon", "scene")


def test_unannotated_samples_and_samples_without_points(root: Path) -> None:
    scene = root / "000001" / "scene_abc.json"
    edit(scene, lambda c: [d["datum"].get("point_cloud", {}).pop("annotations", None) for d in c["data"]])
    assert frames(root)[0].boxes_world is None
    edit(scene, lambda c: [s["datum_keys"].pop(0) for s in c["samples"]])
    (first, _) = frames(root)
    assert first.lidar is None and first.token == "c0" and first.rig.ground.is_default
    np.testing.assert_allclose(first.rig["CAMERA_01"].ego_from_cam.translation, (1.5, 0, 1.6), atol=1e-12)


@pytest.mark.parametrize(
    ("file", "change", "message"),
    [
        ("scene_abc.json", lambda c: c["data"].pop(0), "lists the datum 'l0', which the scene does not have"),
        ("scene_abc.json", lambda c: c.pop("samples"), r"scene_abc\.json: has no field 'samples'"),
        ("scene_abc.json", lambda c: c["samples"].clear(), "has no samples"),
        ("scene_abc.json", lambda c: c["samples"][0]["datum_keys"].pop(1), "has no camera images"),
        ("scene_abc.json", lambda c: c["data"][1]["datum"]["image"]["pose"].pop("rotation"), "datum 'c0': has no field 'rotat"),
        ("scene_abc.json", lambda c: c["data"][0]["id"].update(timestamp="?"), "datum 'l0': '\\?' is not a time"),
        ("calibration/cal.json", lambda c: c["names"].pop(), "1 names, 2 intrinsics"),
        ("calibration/cal.json", lambda c: c["names"].__setitem__(1, "CAMERA_09"), "knows no sensor 'CAMERA_01'"),
        ("calibration/cal.json", lambda c: c["intrinsics"][1].update(k1=-0.3), "CAMERA_01: lens distortion .k1. is not supp"),
        ("calibration/cal.json", lambda c: c["intrinsics"][1].update(fx=0), "camera 'CAMERA_01': K is singular"),
        ("calibration/cal.json", lambda c: c["extrinsics"][0]["rotation"].update(qw=2), "extrinsics of LIDAR: a rotation quat"),
        ("ontology/names.json", lambda c: c["items"].pop(), "class id 1 is not in the ontology"),
        ("bounding_box_3d/LIDAR/0.json", lambda c: c["annotations"][0]["box"].update(width=0), r"0\.json: box 0 has the size"),
        ("bounding_box_3d/LIDAR/0.json", lambda c: c["annotations"][1].pop("box"), "annotation 1: has no field 'box'"),
    ],
)
def test_damage_is_named(root: Path, file: str, change: Callable[[Any], object], message: str) -> None:
    edit(root / "000001" / file, change)
    with pytest.raises(ValueError, match=message):
        frames(root)


def test_missing_and_truncated_files(root: Path) -> None:
    scene = root / "000001"
    whole = frames(root)[1]
    cloud = scene / "point_cloud/LIDAR/1.npz"
    for content, message in ((cloud.read_bytes()[:-200], "not a complete npz"), (b"", "not a complete npz")):
        cloud.write_bytes(content)
        with pytest.raises(ValueError, match=f"1.npz: {message}"):
            whole.lidar.load()
    np.savez(cloud, data=np.zeros((5, 3)))
    with pytest.raises(ValueError, match=r"has shape .5, 3., the scene announces X, Y, Z, INTENSITY"):
        whole.lidar.load()
    cloud.unlink()
    with pytest.raises(ValueError, match=r"1\.npz: the point cloud is missing"):
        whole.lidar.load()
    assert frames(root)[0].rig.ground.offset_m == pytest.approx(-GROUND_M, abs=1e-6)  # from the other cloud
    (scene / "point_cloud/LIDAR/0.npz").unlink()
    with pytest.raises(ValueError, match=r"the ground cannot be fitted.*the point cloud is missing"):
        frames(root)
    (scene / "calibration/cal.json").write_text("{")
    with pytest.raises(ValueError, match=r"cal\.json: not JSON"):
        frames(root)
    (scene / "calibration/cal.json").unlink()
    with pytest.raises(ValueError, match=r"cal\.json: this file of the recording is missing"):
        frames(root)
    (scene / "scene_abc.json").unlink()
    with pytest.raises(ValueError, match=r"scene_abc\.json: this file of the recording is missing"):
        DgpRecording(root)
