"""Damaged own recordings: frames.jsonl, rig files, LiDAR files, masks, folders of images, lists of scenes."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from coin3d.datasets.frame import Frame
from coin3d.datasets.lidar_file import LidarFile
from coin3d.datasets.open import open_recording
from coin3d.datasets.own_recording import OwnRecording
from coin3d.datasets.point_file import PointFile
from coin3d.datasets.splits import chosen_scenes, read_names
from coin3d.geometry import Pose, load_rig, preset_rig, save_rig
from fuzzing import broken_json, damaged, read_through, refused
from own_writer import write_images, write_own
from same_frames import assert_same
from waymo_drive import make_drive

TIMES = 50


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_own(tmp_path_factory.mktemp("own"), [make_drive(frames=2, blank=True)], ".json")


@pytest.fixture
def root(written: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(written, tmp_path / "own"))


def read_all(root: Path) -> list[Frame]:
    return read_through(OwnRecording(root))


def test_lines_with_values_that_make_no_sense(root: Path) -> None:
    rng = np.random.default_rng(0)
    truth = read_all(root)
    path = root / "frames.jsonl"
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    complaints = 0
    for _ in range(3 * TIMES):
        text, changed_type = broken_json(lines, rng)
        path.write_text("\n".join(map(json.dumps, json.loads(text))))
        frames = refused(lambda: read_all(root), str(root))
        complaints += frames is None
        if frames is not None and changed_type:
            for read, frame in zip(frames, truth, strict=True):
                assert_same(read, frame)
    assert complaints > TIMES


def test_lines_cut_off_or_flipped(root: Path) -> None:
    rng = np.random.default_rng(1)
    path = root / "frames.jsonl"
    whole = path.read_bytes()
    for _ in range(TIMES):
        path.write_bytes(damaged(whole, rng))
        refused(lambda: read_all(root), str(root))
    for bomb in (b"[" * 100_000, b'{"token": ' * 50_000, b'{"token": ' + b"9" * 10_000 + b"}"):
        path.write_bytes(bomb)
        assert refused(lambda: read_all(root), str(path)) is None


# --- rig files ---


@pytest.fixture(scope="module")
def rig_text(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("rig") / "rig.yaml"
    save_rig(preset_rig("lyft1"), path)
    return path.read_bytes()


def test_rig_files_cut_off_or_flipped(tmp_path: Path, rig_text: bytes) -> None:
    rng = np.random.default_rng(2)
    path = tmp_path / "rig.yaml"
    for _ in range(TIMES // 2):
        path.write_bytes(damaged(rig_text, rng))
        refused(lambda: load_rig(path), str(path))


RIG: dict[str, Any] = {
    "name": "van",
    "pixel_origin": "opencv",
    "ground": {"normal": [0.0, 0.0, 1.0], "offset": 0.0},
    "cameras": {
        "a": {"size": [96, 64], "focal": 60, "position": [1.0, 0, 1.5], "yaw_deg": 10, "distortion": [0.1, 0.01, 0, 0]},
        "b": {"size": [96, 64], "K": [[60, 0, 47.5], [0, 60, 31.5], [0, 0, 1]], "vehicle_from_cam": preset_rig("waymo")["FRONT"]
              .ego_from_cam.matrix.tolist(), "fisheye": [0.1, 0.0, 0.0, 0.0]},
    },
}  # fmt: skip


def test_rig_files_with_values_that_make_no_sense(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    path = tmp_path / "rig.yaml"
    path.write_text(json.dumps(RIG))  # JSON is YAML
    assert list(load_rig(path)) == ["a", "b"]
    complaints = 0
    for _ in range(2 * TIMES):
        text, _ = broken_json(RIG, rng)
        path.write_text(text.replace("NaN", ".nan").replace("Infinity", ".inf"))
        complaints += refused(lambda: load_rig(path), str(path)) is None
    assert complaints > TIMES


MERGES = "\n".join(["l0: &l0 {k0: 0}", *(f"l{i}: &l{i} {{<<: [{', '.join([f'*l{i - 1}'] * 20)}]}}" for i in range(1, 9))])
ALIASES = "\n".join(["l0: &l0 [x]", *(f"l{i}: &l{i} [{', '.join([f'*l{i - 1}'] * 20)}]" for i in range(1, 9))])


@pytest.mark.parametrize(
    "text",
    [
        MERGES,
        f"{ALIASES}\nname: *l8\ncameras: {{a: {{size: *l8}}}}",
        f"{ALIASES}\ncameras: {{a: {{size: [9, 9], focal: *l8, position: [0, 0, 1], yaw_deg: 0}}}}",
        "cameras: &a {x: *a}",
        "cameras: {? [1, 2] : 3}",
        "cameras: !!int x",
        "cameras: !!timestamp x",
        "cameras: !!bool maybe",
        "cameras: !!float ''",
        "cameras: !!int ''",
        "cameras: !!python/object/apply:os.system [ls]",
        "cameras: 2001-99-99",
        "<<: 3",
        "<<: &a {<<: *a}",
        "cameras: {}\n---\ncameras: {}",
        "[" * 5000,
        "cameras: " + "9" * 5000,
        "cameras: 0x" + "f" * 5000,
        "a: b: c",
        "\x00",
        "#" * (2**20 + 1),
    ],
)
def test_yaml_that_asks_for_trouble(tmp_path: Path, text: str) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text(text)
    assert refused(lambda: load_rig(path), str(path)) is None


def test_merge_keys_still_spare_typing(tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text(
        "cameras:\n"
        "  a: &eye {size: [96, 64], focal: 60, position: [1, 0, 1.5], yaw_deg: 0}\n"
        "  b: {<<: *eye, yaw_deg: 90}\n"
        "  c: {<<: [{yaw_deg: 180}, *eye], focal: 50}\n"
    )
    rig = load_rig(tmp_path / "rig.yaml")
    assert np.rad2deg([camera.yaw_rad for camera in rig.values()]) == pytest.approx([0, 90, 180])
    assert [camera.focal_px for camera in rig.values()] == pytest.approx([60, 60, 50])


@pytest.mark.parametrize("size", ["[96.5, 64]", "[1000000000, 64]", "[96, .inf]", "[-96, 64]", "[96, true]"])
def test_image_sizes_that_no_camera_has(tmp_path: Path, size: str) -> None:
    (tmp_path / "rig.yaml").write_text(f"cameras: {{a: {{size: {size}, focal: 60, position: [1, 0, 1.5], yaw_deg: 0}}}}")
    with pytest.raises(ValueError, match=r"rig\.yaml: camera 'a': "):
        load_rig(tmp_path / "rig.yaml")


# --- LiDAR files ---


def test_lidar_files_cut_off_or_flipped(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    rows = rng.uniform(-50, 50, (40, 4))
    rows.astype("<f4").tofile(tmp_path / "a.bin")
    np.save(tmp_path / "a.npy", rows)
    columns = ("x", "y", "z", "intensity")
    for suffix in ("bin", "npy"):
        path = tmp_path / f"a.{suffix}"
        whole = path.read_bytes()
        for _ in range(3 * TIMES):
            # most of a short file of numbers is header in the one and numbers in the other
            path.write_bytes(damaged(whole, rng) if suffix == "bin" else damaged(whole[:128], rng) + whole[128:])
            scan = refused(PointFile(path, Pose.identity(), columns).load, str(path))
            assert scan is None or (len(scan.points_ego) <= 40 and np.isfinite(scan.points_ego).all())
            if suffix == "bin":
                refused(LidarFile(path, Pose.identity()).load, str(path))


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': '<f8', 'fortran_order': False, 'shape': (-1, 4), }",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (1, 4), 'x': 0}",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (True, 4), }",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999999999999999, 4), }",
        "{'descr': '|V0', 'fortran_order': False, 'shape': (2, 4), }",
        "{'descr': '|O', 'fortran_order': False, 'shape': (2, 4), }",
        "{'descr': '<c16', 'fortran_order': False, 'shape': (2, 4), }",
        "{'descr': ('<f8', 10**9), 'fortran_order': False, 'shape': (2, 4), }",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (" + "1, " * 100 + ")}",
        "-" * 9000 + "1",
        "(" * 3000,
        "{",
        "",
    ],
)
def test_npy_headers_that_make_no_sense(tmp_path: Path, header: str) -> None:
    text = header.encode() + b" " * (-(len(header) + 11) % 64) + b"\n"
    path = tmp_path / "a.npy"
    path.write_bytes(b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + bytes(32))
    assert refused(PointFile(path, Pose.identity(), ("x", "y", "z", "intensity")).load, str(path)) is None


# --- folders and lists ---


def test_folders_of_images_with_files_gone_or_damaged(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    whole = write_images(tmp_path / "van", make_drive(frames=2, blank=True))
    for number in range(TIMES // 5):
        root = Path(shutil.copytree(whole, tmp_path / str(number)))
        files = sorted(root.rglob("*.png"))
        path = files[rng.integers(len(files))]
        kind = rng.integers(4)
        if kind == 0:
            path.unlink()
        elif kind == 1:
            path.write_bytes(damaged(path.read_bytes(), rng))
        elif kind == 2:
            path.rename(path.with_name("..png"))
        else:
            shutil.copy(path, path.with_suffix(".jpg"))
        for frame in refused(lambda root=root: list(open_recording(root)), str(root)) or []:
            for name in frame.rig:
                refused(lambda frame=frame, name=name: frame.image(name), str(root))
        shutil.rmtree(root)


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00", b"a\na\n", b"# nothing\n", b"x" * 300, b"a\x00b\n", b"x\n" * 2**24])
def test_lists_that_are_none(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "scenes.txt"
    path.write_bytes(content)
    assert refused(lambda: read_names(path), str(path)) is None
    assert refused(lambda: chosen_scenes(str(path), ["a"], "here"), str(path)) is None
