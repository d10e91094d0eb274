"""The distance of a rig to those of a training, on cases computed by hand."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from checkpoints import write_checkpoint
from coin3d.augmentation import FocalAugmentation, NovelViewOptions, RigSampler
from coin3d.cli import main
from coin3d.geometry import Camera, GroundPlane, Pose, Rig, camera_pose, preset_rig, save_rig
from coin3d.geometry.rig_changes import raised
from coin3d.priors.reference import reference_maps
from coin3d.rig_report import Span, advice, coverage, rig_distance, verdicts, write_rig_report
from coin3d.rig_report.row_ranges import cell_centres, inverse_maps, row_ranges
from coin3d.rig_report.training_views import SeenView, network_view, training_views
from coin3d.training.seen_rigs import TrainingRigs

SIZE = (704, 256)
OF_THE_RIG = ["top_view.png", "coverage.png", "prior_maps.png"]
PICTURES = ["distance_numbers.png", "distance_ground.png", "distance_directions.png", *OF_THE_RIG]


def pinhole(fov_deg: float, pose: Pose, width: int = 704, height: int = 256) -> Camera:
    focal_px = width / 2 / np.tan(np.deg2rad(fov_deg) / 2)
    return Camera(np.array([[focal_px, 0, width / 2], [0, focal_px, height / 2], [0, 0, 1]]), width, height, pose)


def one(fov_deg: float = 60.0, **mount: float) -> Rig:
    """A rig of one camera, 1.5 m high, that looks forward, level and upright unless told otherwise."""
    at = {"x": 0.0, "y": 0.0, "z": 1.5, "yaw": 0.0, "pitch": 0.0, "roll": 0.0, **mount}
    angles = (np.deg2rad(at[k]) for k in ("yaw", "pitch", "roll"))
    return Rig({"eye": pinhole(fov_deg, camera_pose((at["x"], at["y"], at["z"]), *angles))}, name="one")


def distance(rig: Rig, *trained_on: Rig):
    (camera,) = rig_distance(rig, TrainingRigs(trained_on, SIZE)).shown
    return camera


@pytest.mark.parametrize("name", ["nuscenes", "waymo", "lyft1"])
def test_the_same_rig_is_at_distance_zero(name: str) -> None:
    found = rig_distance(preset_rig(name), TrainingRigs((preset_rig(name),), SIZE))
    assert not found.augmented and found.recorded == found.shown and found.trained_on == (name,)
    for camera in found.shown:
        numbers = asdict(camera)
        assert [v for k, v in numbers.items() if k.endswith("_outside")] == [0.0] * 5
        assert (camera.depth_ratio, camera.depth_beyond_m, camera.direction_deg, camera.offset_m) == (1, 0, 0, 0)
        assert camera.nearest_yaw_deg == 0 and camera.focal_px.ratio == 1
        assert camera.height_m.beyond == camera.pitch_deg.beyond == camera.roll_deg.beyond == camera.fov_deg.beyond == 0
    assert {v.level for v in verdicts(found)} == {"as in training"}


def test_twice_the_focal_length() -> None:
    """Focal lengths tell, whatever the images' sizes: twice as many pixels of the same lens are no difference."""
    wide = one(60)
    half_angle = np.rad2deg(np.arctan(np.tan(np.deg2rad(30)) / 2))
    found = distance(one(2 * half_angle), wide)
    assert found.focal_px.ratio == pytest.approx(2) and found.focal_outside == 1
    # at equal rows below the horizon the ground is twice as deep, f h / rows, but for what lies beyond the cap
    assert found.depth_ratio == pytest.approx(2)
    assert found.direction_outside == 0 and found.offset_m == pytest.approx(0, abs=1e-12)
    assert distance(wide, one(2 * half_angle)).focal_px.ratio == pytest.approx(0.5)
    fine = Rig({"eye": pinhole(60, camera_pose((0, 0, 1.5)), 1408, 512)})
    same = distance(fine, wide)
    assert same.focal_px.ratio == pytest.approx(1) and same.depth_outside == 0 and same.depth_ratio == pytest.approx(1)


def test_a_camera_raised_by_half_a_metre() -> None:
    """Depth in a row scales with the height, 2.0 / 1.5; growth at 20 m is b z^2 / (1 - b z) with b = 1 / (f h)."""
    rig = one(60)
    found = distance(raised(rig, 0.5), rig)
    focal_px = 352 / np.tan(np.deg2rad(30))
    assert found.height_m.beyond == pytest.approx(0.5) and found.depth_ratio == pytest.approx(4 / 3)
    high, low = (400 / (focal_px * h) / (1 - 20 / (focal_px * h)) for h in (2.0, 1.5))
    assert found.growth_m.value == pytest.approx(high) and found.growth_m.ratio == pytest.approx(high / low)
    assert found.focal_outside == 0 and found.direction_outside == 0
    # a forward ray is 0.5 m above its fellow; a ray that looks down or up by a passes 0.5 cos a from it
    assert 0.48 < found.offset_m < 0.5 and found.offset_outside == 1
    # cells: rows 132, 140, ... 252 lie below the horizon at 128; all with ground are outside
    seen = np.count_nonzero(focal_px * 2.0 / (np.arange(132, 256, 8) - 128) <= 60)
    before = np.count_nonzero(focal_px * 1.5 / (np.arange(132, 256, 8) - 128) <= 60)
    assert found.depth_outside == pytest.approx(max(seen, before) / 32)


def test_metres_of_ground_depth_in_the_same_row() -> None:
    """All cells see ground: 60 degrees down; depth beyond is a quarter of the depth for 1.25 times the height."""
    rig = one(40, pitch=50)
    found = distance(raised(rig, 0.375), rig)
    view = network_view(rig["eye"], rig.ground, SIZE)
    u, v = np.arange(4.0, 704, 8), np.arange(4.0, 256, 8)
    depth_m = 1 / inverse_maps(view, u, v)[0]
    # one camera without roll: along a row the depth is constant, so the row's range is its depth
    assert found.depth_beyond_m == pytest.approx(0.25 * np.median(depth_m), rel=1e-6) and found.depth_outside == 1


def test_a_camera_that_looks_where_none_looked() -> None:
    """60 degrees wide to the front; the new one looks to the back: its middle is 150 degrees from the nearest edge."""
    found = distance(one(60, yaw=180), one(60))
    assert found.direction_outside == 1 and found.offset_outside == 1 and found.offset_m is None
    half_deg = 30
    corner_deg = np.rad2deg(np.arccos(found.focal_px.value / np.hypot(found.focal_px.value, 128)))
    assert 180 - half_deg - corner_deg < found.direction_deg <= 180 - half_deg + 1
    assert abs(found.nearest_yaw_deg) == pytest.approx(180) and found.depth_outside == 0 and found.focal_outside == 0
    half = distance(one(60, yaw=30), one(60))  # left half unseen; along the horizon up to the whole 30 degrees
    assert half.direction_outside == pytest.approx(0.5, abs=0.06) and half.direction_deg == pytest.approx(30, abs=1)
    assert half.nearest_yaw_deg == pytest.approx(30)


def test_ranges_of_several_cameras() -> None:
    """Training saw heights 1.2 and 2.0 m: 1.6 m lies between, and so does its ground in every row."""
    between = distance(one(z=1.6), one(z=1.2), one(z=2.0))
    assert between.height_m == Span(pytest.approx(1.6), pytest.approx(1.2), pytest.approx(2.0))
    assert between.depth_outside == between.growth_outside == 0 and between.depth_ratio == pytest.approx(1)
    assert between.offset_m == pytest.approx(0.4, abs=0.02)


def test_an_upside_down_camera() -> None:
    rig = one(60, roll=180)
    found = rig_distance(rig, TrainingRigs((one(60),), SIZE))
    (camera,), (words,) = found.shown, verdicts(found)
    assert camera.growth_m.value is None and camera.growth_m.ratio is None and abs(camera.roll_deg.value) == pytest.approx(180)
    assert camera.depth_ratio is None and camera.depth_outside > 0.8  # ground above, none below
    assert camera.direction_outside == 0 and camera.direction_deg == 0  # it looks the same way
    assert words.level == "far beyond training" and "upside down" in str(words)


def test_the_ground_plane_counts_and_not_the_origin() -> None:
    lowered = Rig(one(z=1.2).cameras, GroundPlane(np.array([0, 0, 1.0]), 0.3))
    found = distance(lowered, one(z=1.5))
    assert found.height_m.beyond == pytest.approx(0) and found.depth_ratio == pytest.approx(1) and found.depth_outside == 0


@settings(max_examples=15, deadline=None)
@given(
    st.floats(30, 100),
    st.floats(0.5, 4),
    st.floats(-20, 40),
    st.floats(-180, 180),
    st.floats(-180, 180),
    st.floats(-0.05, 0.05),
)
def test_inverse_maps_are_the_prior_maps(fov_deg: float, z: float, pitch: float, roll: float, yaw: float, slope: float) -> None:
    """1 / z and 1 / g give back the channels of the reference maps, which shoot a ray through every pixel."""
    camera = pinhole(fov_deg, camera_pose((1, 0.4, z), *np.deg2rad([yaw, pitch, roll])), 64, 24)
    ground = GroundPlane(np.array([slope, -slope, 1.0]), -0.1)
    depth, growth = inverse_maps(SeenView(camera, ground), np.arange(64) + 0.5, np.arange(24) + 0.5)
    maps = reference_maps(camera, ground)
    clear = np.abs(np.where(depth > 0, 1 / np.maximum(depth, 1e-9), 0) - 60) > 1e-6  # not on the edge of the cap
    expected = maps[1] * 25
    np.testing.assert_allclose(depth[clear] * expected[clear], (expected > 0)[clear], atol=1e-9)
    rise_m = expected[:-1] - expected[1:]
    both = (expected[1:] > 0) & (expected[:-1] > 0) & (np.abs(rise_m) > 1e-6)  # less is lost in the difference of depths
    np.testing.assert_allclose(np.log1p(growth[1:][both]) / 2, maps[2][1:][both], rtol=1e-6, atol=1e-9)
    cells = inverse_maps(SeenView(camera, ground), cell_centres(64), cell_centres(24))
    ranges = row_ranges([SeenView(camera, ground)])
    for values, (low, high) in zip(cells, (ranges.depth, ranges.growth), strict=True):
        assert (values >= low[:, None] * (1 - 1e-9)).all() and (values <= high[:, None] * (1 + 1e-9)).all()
        np.testing.assert_allclose(values.min(1), low, rtol=1e-9)  # and no wider than needed
        np.testing.assert_allclose(values.max(1), high, rtol=1e-9)


def test_focal_augmentation_widens_the_range_by_its_ratios() -> None:
    training = TrainingRigs((one(60),), SIZE, FocalAugmentation(0.5, 2.0))
    found = rig_distance(one(60), training)
    focal_px = 352 / np.tan(np.deg2rad(30))
    assert found.augmented and found.recorded[0].focal_px.low == pytest.approx(focal_px)
    # zooming rounds the resized image to whole pixels
    assert found.shown[0].focal_px.low == pytest.approx(focal_px / 2, rel=0.01)
    assert found.shown[0].focal_px.high == pytest.approx(focal_px * 2, rel=0.01)
    zoomed_out = [v for v in training_views(training).drawn if v.camera.focal_px < focal_px * 0.9]
    assert zoomed_out and not any(v.filled for v in zoomed_out), "black borders are no place where a camera looked"
    found = rig_distance(one(100), TrainingRigs((one(60),), SIZE, FocalAugmentation(0.5, 2.0)))
    assert found.shown[0].focal_outside == 0 and found.shown[0].direction_outside > 0.3


def test_drawn_rigs_and_turns_count_as_shown() -> None:
    sampler = RigSampler(focal_ratio=(1.0, 1.0), shift_m=0.0, height_m=(1.0, 2.0), yaw_deg=0.0, tilt_deg=0.0)
    plain = TrainingRigs((one(60),), SIZE)
    drawn = replace(plain, novel_views=NovelViewOptions(0.5, sampler))
    span = rig_distance(one(z=1.9), drawn).shown[0].height_m
    assert 1.0 <= span.low < 1.1 and 1.9 < span.high <= 2.0 and span.beyond == 0
    assert rig_distance(one(z=1.9), drawn).recorded[0].height_m.beyond == pytest.approx(0.4)
    never = replace(drawn, novel_views=NovelViewOptions(0.0, sampler))
    assert not rig_distance(one(), never).augmented
    about = replace(plain, half_turn_probability=0.3)
    assert rig_distance(one(60, yaw=180), about).shown[0].direction_outside == 0
    ring = TrainingRigs((preset_rig("nuscenes"),), SIZE, half_turn_probability=0.3)
    assert not training_views(ring).drawn, "a rig that sees behind is not turned about"
    turned = replace(plain, max_rotation_deg=5.0)
    assert rig_distance(one(60, roll=3), turned).shown[0].depth_outside < 0.1
    assert rig_distance(one(60, roll=3), plain).shown[0].depth_outside > 0.2
    assert rig_distance(one(z=1.9), drawn) == rig_distance(one(z=1.9), drawn), "the same from call to call"


def test_spans() -> None:
    assert (Span(3, 1, 2).beyond, Span(3, 1, 2).ratio, Span(0.5, 1, 2).beyond, Span(1.5, 1, 2).beyond) == (1, 1.5, -0.5, 0)
    assert Span(None, 1, 2).beyond is None and Span(1, None, None).ratio is None


def test_words() -> None:
    found = rig_distance(preset_rig("waymo"), TrainingRigs((preset_rig("nuscenes"),), SIZE))
    words = verdicts(found)
    assert [w.name for w in words] == list(preset_rig("waymo")) and {w.level for w in words} == {"far beyond training"}
    # 2050 px of 1920 against 1250 px of 1600, at an input of 704: 751 and 550
    assert "Focal 1.37x the longest in training (751 against 550 px" in words[0].findings[0]
    assert any(f.startswith("0.55 m higher than the highest camera in training (2.10 m") for f in words[0].findings)
    assert "does not read the prior maps" in advice(words, "direct") and "reads the four prior maps" in advice(words, "coin3d")
    assert "All cameras go" in advice(words, None)
    mixed = rig_distance(Rig({**one().cameras, "high": one(z=2.5)["eye"]}), TrainingRigs((one(),), SIZE))
    assert advice(verdicts(mixed), "none").startswith("One of 2 cameras goes (high) beyond")
    same = rig_distance(one(), TrainingRigs((one(),), SIZE))
    assert advice(verdicts(same), "none").startswith("All cameras lie within")


def test_coverage_by_hand() -> None:
    """90 degrees wide and 40 high, at the origin, 1.5 m up: points half a metre below it, from 10 / tan(20) on in the image."""
    focal_px = 352.0
    camera = Camera(np.array([[focal_px, 0, 352], [0, focal_px, 128], [0, 0, 1]]), 704, 256, camera_pose((0, 0, 1.5)))
    beside = camera.moved(camera_pose((0, 0, 1.5), np.deg2rad(60)))
    at = {c.distance_m: c for c in coverage(Rig({"a": camera, "b": beside}))}
    assert at[20.0].seen_deg == pytest.approx(150, abs=1) and at[20.0].overlapping_deg == pytest.approx(30, abs=1)
    # in the middle depth is 20 m, at the edge, 45 degrees to the side, 20 cos 45
    least, median = at[20.0].pixels_per_metre
    assert least == pytest.approx(focal_px / 20, rel=1e-3) and least < median < focal_px / (20 * np.cos(np.pi / 4))
    # 0.5 m below the lens is in the image where depth is at least 0.5 f / 128 = 1.375 m: at 2 m up to 46 degrees, so everything
    assert at[2.0].seen_deg == pytest.approx(150, abs=1)
    high = coverage(Rig({"a": camera.moved(camera_pose((0, 0, 3.0)))}))[0]
    assert high.seen_deg == 0 and high.pixels_per_metre is None  # 2 m below at 2 m: 45 degrees down


@pytest.mark.filterwarnings("error:constrained_layout")
def test_the_page(tmp_path: Path) -> None:
    cameras = {
        "wide": pinhole(118, camera_pose((2, 0, 1.2), 0.1, 0.2), 640, 480),
        "<roof>": pinhole(60, camera_pose((0, 0, 3.1), 3.0, 0.1, np.pi), 960, 540),
    }
    training = TrainingRigs((preset_rig("nuscenes"),), (352, 128), FocalAugmentation(), NovelViewOptions(), 5.4, 0.3)
    report = write_rig_report(Rig(cameras, name="odd"), tmp_path / "out", training, method="coin3d", source="Weights.")
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == sorted([*PICTURES, "report.html", "result.json"])
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/") == 6 and "&lt;roof&gt;" in page and "<roof>" not in page
    assert "focal length times 0.7 to 1.4" in page and "without augmentation" in page and report.comparison.advice in page
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert [c["name"] for c in result["comparison"]["distance"]["shown"]] == list(cameras) and result["pictures"] == PICTURES
    for name in PICTURES:
        picture = cv2.imread(str(tmp_path / "out" / name))
        assert picture is not None and min(picture.shape[:2]) > 200 and picture.std() > 5


@pytest.mark.filterwarnings("error:constrained_layout")
def test_the_verb(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_rig(one(z=2.4), tmp_path / "van.yaml")
    old = write_checkpoint(tmp_path / "old.safetensors")
    words = ["rig", "report", str(tmp_path / "van.yaml"), "--out", str(tmp_path / "out")]
    assert main([*words, "--checkpoint", str(old)]) == 2
    error = capsys.readouterr().err
    assert "old.safetensors: this checkpoint does not know its training rigs" in error and "--against RIG" in error
    assert not (tmp_path / "out").exists()
    assert main([*words, "--checkpoint", str(old), "--against", "nuscenes", "waymo"]) == 0
    said = capsys.readouterr().out
    assert "eye: far beyond training" in said and "report.html" in said
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    found = result["comparison"]["distance"]
    assert found["trained_on"] == ["nuscenes", "waymo"] and found["augmented"]
    assert main(["rig", "report", str(tmp_path / "van.yaml"), "--out", str(tmp_path / "alone")]) == 0
    result = json.loads((tmp_path / "alone" / "result.json").read_text())
    assert result["comparison"] is None and result["pictures"] == OF_THE_RIG and "1 cameras" in capsys.readouterr().out
