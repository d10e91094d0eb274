"""Recordings on disk are complete nuScenes data, the same bytes every time and the same world for every rig."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from coin3d.datasets.folder_writer import write_folder_recording
from coin3d.datasets.nuscenes_format import NuScenesRecording
from coin3d.datasets.own_recording import OwnRecording
from coin3d.geometry import GroundPlane, Rig, preset_rig
from coin3d.town import TownOptions, record

FEW = TownOptions(traffic=0.5, people=0.4)
SILENT = {"progress": lambda line: None, "options": FEW}


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory, two_cameras: Rig) -> Path:
    out = tmp_path_factory.mktemp("town")
    record(two_cameras, out, [2], key_frames=2, sweeps=True, true_depth=True, **SILENT)
    return out


def _table(out: Path, name: str) -> list[dict]:
    return json.loads((out / "v1.0-town" / f"{name}.json").read_text())


def _digest(out: Path) -> dict[str, str]:
    return {str(p.relative_to(out)): hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(out.rglob("*")) if p.is_file()}


def test_same_bytes_again(recording: Path, two_cameras: Rig, tmp_path: Path) -> None:
    record(two_cameras, tmp_path, [2], key_frames=2, sweeps=True, true_depth=True, **SILENT)
    assert _digest(tmp_path) == _digest(recording)


def test_another_rig_sees_the_same_world(recording: Path, tmp_path: Path) -> None:
    waymo = preset_rig("waymo", width_px=64)
    record(waymo.with_cameras({"FRONT": waymo["FRONT"]}), tmp_path, [2], key_frames=2, **SILENT)
    here, there = NuScenesRecording(recording), NuScenesRecording(tmp_path)
    for a, b in zip(here, there, strict=True):
        assert a.world_from_ego.allclose(b.world_from_ego, atol=0)
        assert a.lidar is not None and b.lidar is not None and a.boxes_world is not None and b.boxes_world is not None
        np.testing.assert_array_equal(a.lidar.load().points_ego, b.lidar.load().points_ego)
        ours = dict(zip(a.boxes_world.instance_ids, a.boxes_world.centre_m, strict=True))
        theirs = dict(zip(b.boxes_world.instance_ids, b.boxes_world.centre_m, strict=True))
        common = ours.keys() & theirs.keys()
        assert len(common) >= 5
        assert all(np.array_equal(ours[n], theirs[n]) for n in common)


def test_counts_of_points_are_exact(recording: Path) -> None:
    for frame in NuScenesRecording(recording):
        assert frame.boxes_world is not None and frame.lidar is not None
        points = frame.world_from_ego.apply(frame.lidar.load().points_ego)
        np.testing.assert_array_equal(frame.boxes_world.count_points(points), frame.boxes_world.num_lidar_points)
        assert (frame.boxes_world.num_lidar_points > 5).sum() >= 3


def test_visibility_is_read_back(recording: Path) -> None:
    levels = np.concatenate([frame.boxes.visibility for frame in NuScenesRecording(recording)])
    written = [int(row["visibility_token"]) for row in _table(recording, "sample_annotation")]
    assert sorted(levels.tolist()) == sorted(written) and {1, 4} <= set(written)


def test_calibration_survives_the_change_of_pixel_origin(recording: Path, two_cameras: Rig) -> None:
    rig = NuScenesRecording(recording)[0].rig
    for name, camera in two_cameras.items():
        np.testing.assert_allclose(rig[name].K, camera.K, atol=1e-12)
        assert rig[name].ego_from_cam.allclose(camera.ego_from_cam, atol=1e-9)


def test_links_and_files(recording: Path) -> None:
    data = _table(recording, "sample_data")
    by_token = {row["token"]: row for row in data}
    for row in data:
        assert (recording / row["filename"]).is_file()
        if row["next"]:
            assert by_token[row["next"]]["prev"] == row["token"]
            assert by_token[row["next"]]["timestamp"] > row["timestamp"]
    sweeps = [row for row in data if row["filename"].startswith("sweeps/")]
    assert len(sweeps) == 4 and not any(row["is_key_frame"] for row in sweeps)
    annotations = {row["token"]: row for row in _table(recording, "sample_annotation")}
    for instance in _table(recording, "instance"):
        first = annotations[instance["first_annotation_token"]]
        assert first["prev"] == "" and first["instance_token"] == instance["token"]
    tokens = [
        row["token"]
        for name in ("sample", "sample_data", "ego_pose", "instance")
        for row in _table(recording, name)
        if name != "ego_pose"
    ]
    assert len(tokens) == len(set(tokens))


def test_true_depth_is_that_of_the_ground(recording: Path, two_cameras: Rig) -> None:
    path = sorted((recording / "truth/depth/CAM_FRONT").glob("*.png"))[0]
    depth_m = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) * 0.01
    camera = two_cameras["CAM_FRONT"]
    expected = -camera.height_m / camera.rays_ego(camera.pixel_grid())[-1, :, 2]
    assert (np.abs(depth_m[-1] - expected) < 0.02).mean() > 0.5


def test_visible_boxes_are_marked_visible(recording: Path, two_cameras: Rig) -> None:
    frame = NuScenesRecording(recording)[0]
    rows = [r for r in _table(recording, "sample_annotation") if r["sample_token"] == frame.token]
    world_from_ego = frame.world_from_ego.inverse()
    unseen = [r for r in rows if not two_cameras.sees(world_from_ego.apply(np.array([r["translation"]]))).any()]
    assert {r["visibility_token"] for r in rows} >= {"1", "4"}
    assert sum(r["visibility_token"] == "4" for r in unseen) == 0


def test_a_repeated_call_renders_nothing_and_can_grow(recording: Path, two_cameras: Rig) -> None:
    lines: list[str] = []
    before = _digest(recording)
    record(two_cameras, recording, [2], key_frames=2, sweeps=True, true_depth=True, options=FEW, progress=lines.append)
    assert lines == ["1 of 1 scenes are there already"]
    assert _digest(recording) == before


def test_other_settings_need_another_folder(recording: Path, two_cameras: Rig) -> None:
    with pytest.raises(ValueError, match="other key_frames, sweeps"):
        record(two_cameras, recording, [2], key_frames=1, true_depth=True, **SILENT)


def test_rounding_does_not_make_another_rig(recording: Path, two_cameras: Rig) -> None:
    def resume(factor: float) -> None:
        rig = two_cameras.with_cameras(
            {name: replace(c, K=c.K * np.array([[factor], [1], [1]])) for name, c in two_cameras.items()}
        )
        record(rig, recording, [2], key_frames=2, sweeps=True, true_depth=True, **SILENT)

    resume(1 + 1e-12)
    with pytest.raises(ValueError, match="other rig"):
        resume(1 + 1e-6)


def test_impossible_recordings(two_cameras: Rig, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="different seeds"):
        record(two_cameras, tmp_path, [1, 1], **SILENT)
    with pytest.raises(ValueError, match="duration_s"):
        record(two_cameras, tmp_path, [1], key_frames=100, **SILENT)
    high = replace(two_cameras, ground=GroundPlane(offset_m=0.3))
    with pytest.raises(ValueError, match="stands on the ground"):
        record(high, tmp_path, [1], **SILENT)
    assert not list(tmp_path.iterdir())


def test_a_copy_as_own_recording_has_the_same_frames(recording: Path, tmp_path: Path) -> None:
    town = NuScenesRecording(recording)
    assert write_folder_recording(town, tmp_path / "copy") == 2
    for frame, copy in zip(town, OwnRecording(tmp_path / "copy"), strict=True):
        links = (frame.token, frame.timestamp_ns, frame.scene, frame.previous, frame.next)
        assert (copy.token, copy.timestamp_ns, copy.scene, copy.previous, copy.next) == links
        assert frame.boxes_world is not None and copy.boxes_world is not None and len(frame.boxes_world) > 5
        for name, column in vars(frame.boxes_world).items():
            np.testing.assert_array_equal(getattr(copy.boxes_world, name), column, name)
        for name, camera in frame.rig.items():
            np.testing.assert_array_equal(copy.image(name), frame.image(name))
            np.testing.assert_array_equal(copy.rig[name].K, camera.K)
            assert copy.rig[name].ego_from_cam.allclose(camera.ego_from_cam, 1e-12)
        assert frame.lidar is not None and copy.lidar is not None
        points = copy.world_from_ego.apply(copy.lidar.load().points_ego)
        np.testing.assert_allclose(copy.lidar.load().points_ego, frame.lidar.load().points_ego, atol=1e-5)
        np.testing.assert_array_equal(copy.boxes_world.count_points(points), frame.boxes_world.num_lidar_points)
