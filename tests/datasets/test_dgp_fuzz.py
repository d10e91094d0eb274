"""Damaged DGP recordings: scene lists, scenes, calibrations, ontologies, boxes and point clouds."""

from __future__ import annotations

import io
import json
import shutil
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from coin3d.datasets import dgp
from coin3d.datasets.dgp import DgpRecording
from coin3d.datasets.dgp_files import PointCloudFile
from coin3d.datasets.frame import Frame
from coin3d.datasets.open import open_recording
from coin3d.geometry import GroundPlane, Pose
from dgp_writer import write_dgp
from fuzzing import broken_json, damaged, read_through, refused
from same_frames import assert_same
from waymo_drive import make_drive

FILES = {
    "list": "ddad.json",
    "scene": "*/scene_*.json",
    "calibration": "*/calibration/*.json",
    "ontology": "*/ontology/*.json",
    "boxes": "*/bounding_box_3d/LIDAR/*.json",
}
TIMES = 40


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_dgp(tmp_path_factory.mktemp("dgp"), [make_drive(frames=2, blank=True)])


@pytest.fixture
def root(written: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(dgp, "_fitted_ground", lambda scene: GroundPlane())  # takes longer than all the rest
    return Path(shutil.copytree(written, tmp_path / "dgp"))


def read_all(root: Path) -> list[Frame]:
    return read_through(open_recording(root))


@pytest.mark.parametrize("kind", FILES)
def test_json_with_values_that_make_no_sense(root: Path, kind: str) -> None:
    rng = np.random.default_rng(sorted(FILES).index(kind))
    truth = read_all(root)
    path = min(root.glob(FILES[kind]))
    content = json.loads(path.read_text())
    complaints = 0
    for _ in range(TIMES):
        text, changed_type = broken_json(content, rng)
        path.write_text(text)
        # a list of scenes without its one key is no recording at all, and a missing file is named itself
        frames = refused(lambda: read_all(root), str(root))
        complaints += frames is None
        if frames is not None and changed_type:
            for read, frame in zip(frames, truth, strict=True):
                assert_same(read, frame)
    assert complaints > TIMES / 6


@pytest.mark.parametrize("kind", FILES)
def test_json_cut_off_or_flipped(root: Path, kind: str) -> None:
    rng = np.random.default_rng(sorted(FILES).index(kind))
    path = min(root.glob(FILES[kind]))
    whole = path.read_bytes()
    for _ in range(TIMES // 2):
        path.write_bytes(damaged(whole, rng))
        refused(lambda: read_all(root), str(root))
    path.write_bytes(b"[" * 100_000)
    assert refused(lambda: read_all(root), str(root)) is None


def test_point_clouds_cut_off_or_flipped(root: Path) -> None:
    rng = np.random.default_rng(0)
    path = min(root.glob("*/point_cloud/LIDAR/*.npz"))
    whole = path.read_bytes()
    file = PointCloudFile(path, ["X", "Y", "Z", "INTENSITY"], Pose.identity(), np.zeros(3))
    truth = file.load()
    for _ in range(4 * TIMES):
        path.write_bytes(damaged(whole, rng))
        scan = refused(file.load, str(path))
        if scan is not None:  # the archive has a checksum
            np.testing.assert_array_equal(scan.points_ego, truth.points_ego)


def npz(path: Path, header: str, data: bytes, **more: Any) -> Path:
    """An archive with one array whose header says anything."""
    text = header.encode() + b" " * (-(len(header) + 11) % 64) + b"\n"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("data.npy", b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + data)
    return path


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': '<f8', 'fortran_order': False, 'shape': (1099511627776, 4), }",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (-1, 4), }",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (0, 1099511627776), }",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (2,), }",
        "{'descr': '|O', 'fortran_order': False, 'shape': (2, 4), }",
        "{'descr': '<U4', 'fortran_order': False, 'shape': (2, 2), }",
        "{'descr': [('x', '<f8')], 'fortran_order': False, 'shape': (2, 4), }",
        "{'descr': '<f8', 'fortran_order': 7, 'shape': (2, 4), }",
        "{'descr': 'nonsense', 'fortran_order': False, 'shape': (2, 4), }",
        "{'descr': '<f8', 'fortran_order': False, 'shape': " + "(" * 400 + ")" * 400 + ", }",
        "-" * 9000 + "1",
        "{",
    ],
)
def test_arrays_that_lie_about_themselves(tmp_path: Path, header: str) -> None:
    path = npz(tmp_path / "0.npz", header, bytes(64))
    file = PointCloudFile(path, ["X", "Y", "Z", "I"], Pose.identity(), np.zeros(3))
    assert refused(file.load, str(path)) is None


def test_an_archive_that_unpacks_to_gigabytes(tmp_path: Path) -> None:
    content = io.BytesIO()
    np.save(content, np.zeros((2**22, 10)))
    with zipfile.ZipFile(tmp_path / "0.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("data.npy", content.getvalue())
    assert (tmp_path / "0.npz").stat().st_size < 3_000_000
    with pytest.raises(ValueError, match=r"0\.npz: not a complete npz.*takes \d+ bytes, more than"):
        PointCloudFile(tmp_path / "0.npz", ["X", "Y", "Z"], Pose.identity(), np.zeros(3)).load()


@pytest.mark.parametrize(
    ("file", "place", "value", "message"),
    [
        ("scene", ("data", "*", "datum", "image", "filename"), "../../secret.png", "leads out of the recording"),
        ("scene", ("data", "*", "datum", "image", "width"), 10**9, "width: a whole number from 1 to 32767"),
        ("scene", ("data", "*", "datum", "image", "width"), 96.5, "width: a whole number"),
        ("scene", ("data", "*", "datum", "point_cloud", "filename"), "/etc/passwd", "leads out of the recording"),
        ("scene", ("data", "*", "datum", "point_cloud", "annotations", "1"), "../b.json", "leads out of the recording"),
        ("scene", ("data", "*", "datum", "point_cloud", "point_format"), ["X"] * 4, "announces a column twice"),
        ("scene", ("samples", "*", "calibration_key"), "../other", "a name of 1 to 200"),
        ("scene", ("ontologies", "1"), "../names", "a name of 1 to 200"),
        ("scene", ("data", "*", "id", "timestamp"), "0001-01-01T00:00:00Z", "before 1970"),
        ("scene", ("data", "*", "id", "timestamp"), 7, "is not a time"),
        ("scene", ("data", "*", "id", "name"), "FRONT", "two data of the sensor 'FRONT'"),
        ("list", ("scene_splits", "0", "filenames"), ["../x/scene_1.json"], "leads out of the recording"),
        ("list", ("scene_splits", "0", "filenames"), "scene", "'filenames' is a list"),
        ("list", ("scene_splits",), [], "'scene_splits' names lists by number"),
        ("boxes", ("annotations", "*", "num_points"), 10**30, "num_points: a whole number"),
        ("boxes", ("annotations", "*", "class_id"), True, "class_id: a whole number"),
        ("boxes", ("annotations", "*", "box", "length"), "4", "length: a number is expected"),
        ("boxes", ("annotations", "*", "instance_id"), {"a": 1}, "instance_id is a number or a text"),
        ("calibration", ("names",), ["LIDAR"] * 6, "each once"),
        ("calibration", ("intrinsics", "*"), 5, "fx, fy, cx, cy are expected"),
        ("calibration", ("intrinsics", "*", "fx"), "80", "fx: a number is expected"),
    ],
)
def test_what_must_not_pass(root: Path, file: str, place: tuple[str, ...], value: Any, message: str) -> None:
    path = min(root.glob(FILES[file]))
    content = json.loads(path.read_text())
    put(content, place, value)
    path.write_text(json.dumps(content))
    with pytest.raises(ValueError, match=message) as caught:
        read_all(root)
    assert str(root) in str(caught.value)


def put(content: Any, place: tuple[str, ...], value: Any) -> None:
    """The value at every place that a ``*`` stands for."""
    key, rest = place[0], place[1:]
    for k in range(len(content)) if key == "*" else [key] if key in content else []:
        if rest:
            put(content[k], rest, value)
        else:
            content[k] = value


def test_two_scenes_in_one_folder_and_data_that_come_twice(root: Path) -> None:
    scene = min(root.glob("*/scene_*.json"))
    content = json.loads(scene.read_text())
    scene.write_text(json.dumps({**content, "data": content["data"] + content["data"][:1]}))
    with pytest.raises(ValueError, match="is there twice"):
        DgpRecording(root)
    shutil.copy(scene, scene.with_name("scene_other.json"))
    with pytest.raises(ValueError, match="several files"):
        DgpRecording(scene.parent)
