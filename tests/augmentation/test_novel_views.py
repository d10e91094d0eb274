"""Rendered samples: the cameras, the depth and the boxes tell the story of the drawn rig."""

from __future__ import annotations

import json
import pickle
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from coin3d.augmentation import (
    ArrayChange,
    BevAugmentation,
    FocalAugmentation,
    ImageAugmentation,
    NovelViewOptions,
    NovelViews,
    RigSampler,
    novel_views,
)
from coin3d.datasets.classes import ClassMap
from coin3d.datasets.frame import Frame
from coin3d.detectors.inputs import lidar_depth
from coin3d.geometry import Camera
from coin3d.rendering import Gaussians, Rendering, save_gaussians
from coin3d.rendering.gaussian_folder import GaussianFolder
from coin3d.training.samples import AugmentOptions, TrainingSamples
from small_world import SIZE_PX, MemoryRecording, frame, ring_rig

BOTH = ClassMap("both", {"car": "car", "pedestrian": "pedestrian"})
STILL = AugmentOptions(ImageAugmentation(0.0, 0.0), BevAugmentation(0.0, 1.0, 1.0, 0.0))
ALWAYS = NovelViewOptions(probability=1.0)


class Painter:
    """Paints every image in one colour and remembers what it was asked for."""

    def __init__(self, covered: Sequence[float] = ()) -> None:
        self.asked: list[list[Camera]] = []
        self.covered = covered

    def __call__(self, gaussians: Gaussians, cameras: Sequence[Camera]) -> list[Rendering]:
        assert len(gaussians) == 1
        self.asked.append(list(cameras))
        out = []
        for i, camera in enumerate(cameras):
            shape = (camera.height_px, camera.width_px)
            alpha = np.zeros(shape, np.float32)
            alpha[:, : round(shape[1] * (self.covered[i] if self.covered else 1.0))] = 1
            out.append(Rendering(np.full((*shape, 3), 200, np.uint8), alpha * 5, alpha))
        return out


def in_scene(seed: int, cameras: int, scene: str = "street") -> Frame:
    return replace(frame(seed, ring_rig(cameras, size_px=(192, 128), focal_px=120.0)), scene=scene)


def folder(root: Path, *frames: Frame, raw_only: Sequence[str] = ()) -> GaussianFolder:
    dot = Gaussians(np.array([[9, 0, 1]], np.float32), np.array([0.1], np.float32), np.array([[255, 0, 0]], np.uint8))
    for f in frames:
        save_gaussians(root / f.scene / f"{f.token}.safetensors", dot)
    (root / "scenes.json").write_text(json.dumps({"raw_only": dict.fromkeys(raw_only, "a bus came out badly")}))
    return GaussianFolder.open(root)


def samples(frames: Sequence[Frame], views: NovelViews, augment: AugmentOptions = STILL) -> TrainingSamples:
    return TrainingSamples([MemoryRecording(frames)], BOTH, SIZE_PX, augment, FocalAugmentation(), 0, 1000, views)


def test_cameras_depth_and_boxes_are_those_of_the_drawn_rig(tmp_path: Path) -> None:
    f, painter = in_scene(2, 4), Painter()
    drawn = samples([f], NovelViews(ALWAYS, folder(tmp_path, f), painter))[0]
    assert (drawn.images == 200).all() and drawn.images.shape == (4, SIZE_PX[1], SIZE_PX[0], 3)
    assert f.lidar is not None and f.boxes is not None and drawn.boxes is not None and drawn.depth_m is not None
    points = f.lidar.load().points_ego
    for asked, camera, depth, source in zip(painter.asked[0], drawn.cameras, drawn.depth_m, f.rig.values(), strict=True):
        np.testing.assert_array_equal(asked.K, camera.K)  # rendered at the size of the network input: nothing is resampled
        assert (camera.width_px, camera.height_px) == SIZE_PX
        ratio = camera.focal_px / (source.focal_px / 2)
        assert 0.7 <= ratio <= 1.4 and not camera.ego_from_cam.allclose(source.ego_from_cam)
        np.testing.assert_array_equal(depth, lidar_depth(points, camera))
        assert (depth > 0).any()
    seen = np.any([c.sees(f.boxes.centre_m) for c in drawn.cameras], axis=0)
    np.testing.assert_array_equal(drawn.boxes.centre_m, f.boxes.centre_m[seen])


def test_boxes_no_camera_sees_are_kept_if_asked(tmp_path: Path) -> None:
    f = in_scene(3, 4)
    views = NovelViews(ALWAYS, folder(tmp_path, f), Painter())
    one = replace(STILL, cameras_per_sample=1)
    few, all_of_them = samples([f], views, one)[0], samples([f], views, replace(one, keep_unseen_boxes=True))[0]
    assert f.boxes is not None and few.boxes is not None and all_of_them.boxes is not None
    assert len(few.boxes) < len(all_of_them.boxes) == len(f.boxes)


def test_half_of_the_samples_are_raw_and_zoomed(tmp_path: Path) -> None:
    f, painter = in_scene(0, 2), Painter()
    drawn = samples([f], NovelViews(NovelViewOptions(), folder(tmp_path, f), painter))
    rendered = [bool((drawn[n].images == 200).all()) for n in range(120)]
    assert 42 <= sum(rendered) == len(painter.asked) <= 78
    raw = drawn[rendered.index(False)]
    for camera, source in zip(raw.cameras, f.rig.values(), strict=True):
        assert camera.ego_from_cam.allclose(source.ego_from_cam)
        assert abs(camera.focal_px / (source.focal_px / 2) - 1) > 1e-3  # focal augmentation is for raw views


def test_a_sample_is_a_function_of_its_number(tmp_path: Path) -> None:
    frames = [in_scene(i, 3) for i in range(3)]
    options = NovelViewOptions(0.7, RigSampler(array=ArrayChange()))
    views = NovelViews(options, folder(tmp_path, *frames), Painter())
    augment = AugmentOptions(cameras_per_sample=2)
    one, two = samples(frames, views, augment), samples(frames, pickle.loads(pickle.dumps(views)), augment)
    later = [two[n] for n in (9, 4, 0, 7)]
    for number, sample in zip((9, 4, 0, 7), later, strict=True):
        again = one[number]
        np.testing.assert_array_equal(again.images, sample.images)
        assert all(np.array_equal(a.K, b.K) for a, b in zip(again.cameras, sample.cameras, strict=True))
        np.testing.assert_array_equal(again.bev_from_ego, sample.bev_from_ego)


def test_only_chosen_cameras_are_rendered(tmp_path: Path) -> None:
    f, painter = in_scene(1, 5), Painter()
    drawn = samples([f], NovelViews(ALWAYS, folder(tmp_path, f), painter), replace(STILL, cameras_per_sample=2))
    for n in range(8):
        assert len(drawn[n].cameras) == 2
    assert [len(asked) for asked in painter.asked] == [2] * 8
    varied = NovelViews(NovelViewOptions(1.0, RigSampler(array=ArrayChange())), folder(tmp_path, f), Painter())
    some = samples([f], varied, replace(STILL, cameras_per_sample=2))
    assert {len(some[n].cameras) for n in range(40)} == {1, 2}
    every = samples([f], varied)
    assert {len(every[n].cameras) for n in range(60)} >= {1, 3, 5, 7, 8}


def test_frames_without_gaussians_and_scenes_set_aside_stay_raw(tmp_path: Path) -> None:
    good, aside, bare = in_scene(0, 2), in_scene(1, 2, scene="bus-crash"), in_scene(2, 2)
    views = NovelViews(ALWAYS, folder(tmp_path, good, aside, raw_only=["bus-crash"]), Painter())
    rendered = [(samples([f], views)[0].images == 200).all() for f in (good, aside, bare)]
    assert rendered == [True, False, False]


def test_views_of_nothing_are_left_out(tmp_path: Path) -> None:
    f = in_scene(4, 3)
    place = folder(tmp_path, f)
    drawn = samples([f], NovelViews(ALWAYS, place, Painter(covered=[1.0, 0.1, 0.4])))[0]
    assert len(drawn.cameras) == len(drawn.images) == 2
    empty = samples([f], NovelViews(ALWAYS, place, Painter(covered=[0.0] * 3)))[0]
    assert len(empty.cameras) == 3 and not (empty.images == 200).all()  # raw


def test_rows_above_a_low_image_are_black_as_in_raw_views(tmp_path: Path) -> None:
    f = replace(frame(0, ring_rig(1, size_px=(96, 40))), scene="street")
    drawn = samples([f], NovelViews(ALWAYS, folder(tmp_path, f), Painter()))[0]
    assert (drawn.images[0, :24] == 0).all() and (drawn.images[0, 24:] == 200).all()


def test_folders_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no such folder"):
        GaussianFolder.open(tmp_path / "absent")
    with pytest.raises(FileNotFoundError, match=r"holds no <scene>/<frame token>\.safetensors"):
        GaussianFolder.open(tmp_path)
    f = in_scene(0, 1)
    place = folder(tmp_path, f)
    place.path(f.scene, f.token).write_bytes(b"half a fi")
    with pytest.raises(ValueError, match="frame0"):
        samples([f], NovelViews(ALWAYS, place, Painter()))[0]
    (tmp_path / "scenes.json").write_text('["a"]')
    with pytest.raises(ValueError, match=r"scenes\.json: not a JSON object"):
        GaussianFolder.open(tmp_path)
    assert novel_views(None, None) is None
    with pytest.raises(ValueError, match="--gaussians"):
        novel_views(ALWAYS, None)
    with pytest.raises(ValueError, match="probability"):
        NovelViewOptions(probability=1.5)


def test_the_renderer_itself_draws_what_the_camera_sees(tmp_path: Path) -> None:
    """Small red balls at the boxes before a blue sky, drawn by the true renderer: red where their centres project."""
    f = in_scene(5, 4)
    assert f.boxes is not None
    rng = np.random.default_rng(0)
    around = np.concatenate([f.boxes.centre_m, rng.normal(size=(4000, 3)) * 60 + [0, 0, 40]]).astype(np.float32)
    std = np.concatenate([np.full(len(f.boxes), 0.15), np.full(4000, 4.0)]).astype(np.float32)
    far = np.linalg.norm(around, axis=1) > 35
    far[: len(f.boxes)] = True
    colours = np.full((len(around), 3), (0, 0, 90), np.uint8)
    colours[: len(f.boxes)] = (255, 0, 0)
    save_gaussians(tmp_path / "street" / f"{f.token}.safetensors", Gaussians(around[far], std[far], colours[far]))
    drawn = samples([f], NovelViews(ALWAYS, GaussianFolder.open(tmp_path)))[0]
    found = 0
    for image, camera in zip(drawn.images, drawn.cameras, strict=True):
        pixels, depth_m = camera.project(f.boxes.centre_m)
        for (u, v), z in zip(pixels, depth_m, strict=True):
            if z > 3 and 0 < u < SIZE_PX[0] and 0 < v < SIZE_PX[1]:
                assert image[int(v), int(u), 0] > 150
                found += 1
        assert (image[..., 0] > 100).mean() < 0.05 and (image[..., 2] > 60).mean() > 0.8
    assert found >= 3
