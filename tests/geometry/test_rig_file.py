"""rig.yaml: what a person types, what comes back, and every complaint."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from coin3d.geometry import (
    BrownConrady,
    Camera,
    Fisheye,
    GroundPlane,
    Lens,
    Pinhole,
    Pose,
    Rig,
    camera_pose,
    load_rig,
    preset_rig,
    save_rig,
)

GOOD = """
name: my car
cameras:
  front: {size: [1280, 720], focal: 900, position: [1.5, 0, 1.4], yaw_deg: 0, pitch_deg: 2}
  left:
    size: [640, 480]
    K: [[400, 0, 319.5], [0, 410, 239.5], [0, 0, 1]]
    position: [1, 0.4, 1.4]
    quaternion: [0.5, -0.5, 0.5, -0.5]
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "rig.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def camera_text(**changes: str | None) -> str:
    keys: dict[str, str | None] = {"size": "[640, 480]", "focal": "400", "position": "[1, 0, 1.5]", "yaw_deg": "0", **changes}
    return "cameras:\n  front: {" + ", ".join(f"{k}: {v}" for k, v in keys.items() if v is not None) + "}\n"


def test_a_typed_rig(tmp_path: Path) -> None:
    rig = load_rig(write(tmp_path, GOOD))
    assert rig.name == "my car" and list(rig) == ["front", "left"] and rig.ground.is_default
    front, left = rig["front"], rig["left"]
    np.testing.assert_allclose(front.K, [[900, 0, 640], [0, 900, 360], [0, 0, 1]])
    assert front.ego_from_cam.allclose(camera_pose((1.5, 0, 1.4), pitch_rad=np.deg2rad(2)))
    # OpenCV's pixel centres lie at whole numbers, ours at halves
    np.testing.assert_allclose(left.K, [[400, 0, 320], [0, 410, 240], [0, 0, 1]])
    assert left.ego_from_cam.allclose(camera_pose((1, 0.4, 1.4)))


def test_edge_origin_and_field_of_view(tmp_path: Path) -> None:
    text = "pixel_origin: edge\n" + camera_text(focal="[400, 420]", centre="[300, 200]")
    np.testing.assert_allclose(load_rig(write(tmp_path, text))["front"].K, [[400, 0, 300], [0, 420, 200], [0, 0, 1]])
    text = camera_text(focal="[400, 420]", centre="[300, 200]")
    np.testing.assert_allclose(load_rig(write(tmp_path, text))["front"].K[:2, 2], [300.5, 200.5])
    camera = load_rig(write(tmp_path, camera_text(focal=None, fov_deg="90")))["front"]
    assert np.rad2deg(camera.fov_horizontal_rad) == pytest.approx(90)


def test_cameras_are_given_in_the_vehicle_frame(tmp_path: Path) -> None:
    # the user's frame starts at a sensor 1.8 m above the ground and looks left
    vehicle = Pose.from_euler(np.pi / 2, 0, 0, (0.5, 0, 1.8))
    text = f"ego_from_vehicle: {vehicle.matrix.tolist()}\n" + camera_text(position="[1, 0, -0.3]")
    rig = load_rig(write(tmp_path, text))
    np.testing.assert_allclose(rig["front"].ego_from_cam.translation, [0.5, 1, 1.5])
    assert np.rad2deg(rig["front"].yaw_rad) == pytest.approx(90)
    assert rig.ego_from_vehicle.allclose(vehicle)


def test_every_preset_round_trips(tmp_path: Path) -> None:
    for name in ("nuscenes", "lyft1", "lyft2", "waymo"):
        assert_same(preset_rig(name), through_file(preset_rig(name), tmp_path))


def test_an_awkward_rig_round_trips(tmp_path: Path) -> None:
    skewed = np.array([[700.0, 3.0, 411.25], [-2.0, 690.0, 222.125], [0, 0, 1]])
    cameras = {
        "a b": Camera(skewed, 801, 455, camera_pose((0.3, -0.2, 1.9), 2.5, 0.1, -0.2)),
        "0": Camera(skewed, 801, 455, camera_pose((0.3, -0.2, 1.9), -2.5)),
    }
    rig = Rig(cameras, GroundPlane(np.array([0.02, -0.01, 1]), 0.1), Pose.from_euler(0.4, 0.1, 0, (1, 2, 0.7)), "awkward")
    again = through_file(rig, tmp_path)
    assert_same(rig, again)
    np.testing.assert_allclose([*again.ground.normal, again.ground.offset_m], [*rig.ground.normal, rig.ground.offset_m])
    assert again.ego_from_vehicle.allclose(rig.ego_from_vehicle)


def test_lenses_as_opencv_writes_them(tmp_path: Path) -> None:
    for written, lens in (
        ({"distortion": "[-0.3, 0.1, 0.001, -0.002]"}, BrownConrady(k1=-0.3, k2=0.1, p1=0.001, p2=-0.002)),
        ({"distortion": "[-0.3, 0.1, 0.001, -0.002, 0.03]"}, BrownConrady(-0.3, 0.1, 0.001, -0.002, k3=0.03)),
        ({"distortion": "[2, 0.4, 0, 0, 0.01, 2.5, 1, 0.1]"}, BrownConrady(2, 0.4, 0, 0, 0.01, k4=2.5, k5=1, k6=0.1)),
        ({"fisheye": "[0.1, -0.02, 0.003, 0]"}, Fisheye(0.1, -0.02, 0.003, 0)),
        ({}, Pinhole()),
    ):
        camera = load_rig(write(tmp_path, camera_text(**written)))["front"]
        assert camera.lens == lens
        rig = Rig({"front": camera})
        assert_same(rig, through_file(rig, tmp_path))


def through_file(rig: Rig, folder: Path) -> Rig:
    save_rig(rig, folder / "saved.yaml")
    assert not list(folder.glob("*.part"))
    return load_rig(folder / "saved.yaml")


def assert_same(a: Rig, b: Rig) -> None:
    assert list(a) == list(b) and a.name == b.name
    for name in a:
        np.testing.assert_array_equal(a[name].K, b[name].K)
        assert a[name].lens == b[name].lens
        assert (a[name].width_px, a[name].height_px) == (b[name].width_px, b[name].height_px)
        assert a[name].ego_from_cam.allclose(b[name].ego_from_cam, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[1, 2]", "'cameras:' with one entry per camera"),
        ("cameras: {}", "'cameras:' with one entry per camera"),
        ("cameras: {front: [", "not readable as YAML"),
        ("colour: red\n" + camera_text(), "the rig has unknown keys colour"),
        ("pixel_origin: centre\n" + camera_text(), "pixel_origin is 'opencv'"),
        ("cameras: {front: 3}", "camera 'front': expected keys such as size"),
        (camera_text(zoom="3"), "camera 'front' has unknown keys zoom"),
        (camera_text(size=None), "camera 'front': 'size' is missing"),
        (camera_text(size="[640]"), "'size' takes 2 numbers"),
        (camera_text(size="[0, 480]"), "camera 'front'.*0 x 480"),
        (camera_text(focal=None), "exactly one of K, focal, fov_deg .found: none"),
        (camera_text(fov_deg="90"), "exactly one of K, focal, fov_deg .found: focal, fov_deg"),
        (camera_text(focal=None, fov_deg="190"), "between 0 and 180, got 190"),
        (camera_text(distortion="[0, 0, 0, 0]", fisheye="[0, 0, 0, 0]"), "camera 'front': give distortion .* or fisheye"),
        (camera_text(distortion="[0, 0, 0]"), "camera 'front': 'distortion' is .k1, k2, p1, p2."),
        (camera_text(distortion="0.1"), "camera 'front': 'distortion' is .k1, k2, p1, p2."),
        (camera_text(distortion="[" + "0, " * 11 + "0]"), "camera 'front': 'distortion' is .k1, k2, p1, p2."),
        (camera_text(distortion="[0, 0, 0, a]"), "camera 'front': 'distortion' takes 4 numbers"),
        (camera_text(distortion="[0, 0, 0, .inf]"), "'distortion' holds a number that is not finite"),
        (camera_text(distortion="[-1000000.0, 0, 0, 0]"), "camera 'front': the Brown-Conrady lens .* folds back"),
        (camera_text(fisheye="[0, 0, 0]"), "camera 'front': 'fisheye' takes 4 numbers"),
        (camera_text(focal=None, fov_deg="90", fisheye="[0, 0, 0, 0]"), "camera 'front': with fisheye say how long"),
        (camera_text(focal="0"), "camera 'front': K is singular"),
        (camera_text(focal="true"), "'focal' takes 1 number, got True"),
        (camera_text(focal=".nan"), "'focal' holds a number that is not finite"),
        (camera_text(focal="abc"), "'focal' takes 1 number, got 'abc'"),
        (camera_text(focal="[1, 2, 3]"), "'focal' takes 2 numbers"),
        (camera_text(focal=None, K="[[1, 0], [0, 1]]"), "camera 'front': K is a 3 x 3 matrix"),
        (camera_text(focal=None, K="[[1, 0], [0]]"), "camera 'front': K is not a matrix of numbers"),
        (camera_text(focal=None, K="[[400, 0, 0], [0, 400, 0], [320, 240, 1]]"), "camera 'front'.*transposed"),
        (camera_text(yaw_deg=None), "say where it looks"),
        (camera_text(position=None), "'position' is missing"),
        (camera_text(position="[0, 0, 0]"), "at or below the ground"),
        (camera_text(yaw_deg=None, quaternion="[1, 1, 0, 0]"), "camera 'front'.*length 1"),
        (camera_text(vehicle_from_cam="[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"), "remove position, yaw_deg"),
        (
            camera_text(position=None, yaw_deg=None, vehicle_from_cam="[[2,0,0,0],[0,1,0,0],[0,0,1,9],[0,0,0,1]]"),
            "camera 'front': vehicle_from_cam: not a rotation",
        ),
        ("ground: 3\n" + camera_text(), "ground: needs 'normal"),
        ("ground: {normal: [0, 0, -1], offset: 0}\n" + camera_text(), "point up"),
        ("ego_from_vehicle: [1]\n" + camera_text(), "ego_from_vehicle is a 4 x 4 matrix"),
    ],
)
def test_every_complaint_names_the_file_and_the_remedy(tmp_path: Path, text: str, message: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(ValueError, match=message) as error:
        load_rig(path)
    assert str(error.value).startswith(str(path))


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"none.yaml: no such rig file"):
        load_rig(tmp_path / "none.yaml")


class _Mirror:
    """A lens that rig files do not know."""

    def plane_from_ray(self, rays_cam: np.ndarray) -> np.ndarray:
        return -rays_cam[..., :2] / rays_cam[..., 2:]

    def ray_from_plane(self, plane: np.ndarray) -> np.ndarray:
        return np.concatenate([-plane, np.ones_like(plane[..., :1])], axis=-1)


def test_a_lens_that_files_cannot_hold_leaves_nothing_behind(tmp_path: Path) -> None:
    lens: Lens = _Mirror()
    front = preset_rig("waymo")["FRONT"]
    rig = Rig({"odd": Camera(front.K, front.width_px, front.height_px, front.ego_from_cam, lens)})
    with pytest.raises(ValueError, match="camera 'odd' has the lens"):
        save_rig(rig, tmp_path / "rig.yaml")
    assert not list(tmp_path.iterdir())
