"""The rigs of a training: gathered, made distinct, kept with the weights, read back."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from coin3d.augmentation import FocalAugmentation, ImageAugmentation, NovelViewOptions, NovelViews, RigSampler
from coin3d.datasets.classes import THREE_CLASS
from coin3d.datasets.open import open_recording
from coin3d.geometry import Camera, GroundPlane, Pose, Rig, preset_rig
from coin3d.geometry.rig_changes import raised
from coin3d.methods import METHODS, CoIn3DOptions
from coin3d.rendering.gaussian_folder import GaussianFolder
from coin3d.training.checkpoint import describe, read_description
from coin3d.training.options import TrainOptions
from coin3d.training.samples import AugmentOptions
from coin3d.training.seen_rigs import (
    DESCRIPTION_KEY,
    TrainingRigs,
    distinct_rigs,
    gather_training_rigs,
    named_rigs,
    rigs_of_description,
)
from coin3d.training.train import train
from small_world import CONFIG
from tiny_recording import CAMERAS

SIZE = (96, 64)
FULL = TrainingRigs(
    (preset_rig("nuscenes"), Rig(preset_rig("waymo").cameras, GroundPlane(np.array([0.02, 0, 1.0]), -0.1), name="slope")),
    (704, 256),
    FocalAugmentation(0.8, 1.3),
    NovelViewOptions(0.4, RigSampler.target_aware_lyft()),
    5.4,
    0.3,
)


def changed(rig: Rig, *, focal: float = 1.0, metres: float = 0.0, degrees: float = 0.0) -> Rig:
    """The rig with its last camera changed."""
    name, camera = list(rig.items())[-1]
    turn = Pose.from_euler(np.deg2rad(degrees), 0, 0, (metres, 0, 0))
    pose = Pose(turn.rotation @ camera.ego_from_cam.rotation, camera.ego_from_cam.translation + turn.translation)
    K = camera.K @ np.diag([focal, focal, 1.0])
    return rig.with_cameras({**rig.cameras, name: Camera(K, camera.width_px, camera.height_px, pose)})


def test_what_is_written_is_read_back() -> None:
    plain = json.loads(json.dumps(FULL.plain()))
    back = TrainingRigs.from_plain(plain)
    assert [rig.name for rig in back.rigs] == ["nuscenes", "slope"] and back.size_px == (704, 256)
    assert (back.focal, back.novel_views) == (FULL.focal, FULL.novel_views)
    assert (back.max_rotation_deg, back.half_turn_probability) == (5.4, 0.3)
    for ours, theirs in zip(back.rigs, FULL.rigs, strict=True):
        np.testing.assert_allclose(ours.ground.normal, theirs.ground.normal, atol=1e-6)
        for name, camera in theirs.items():
            np.testing.assert_allclose(ours[name].K, camera.K, atol=1e-6)
            np.testing.assert_allclose(ours[name].ego_from_cam.matrix, camera.ego_from_cam.matrix, atol=1e-5)
    assert len(json.dumps(plain)) < 12_000


def test_what_counts_as_another_rig() -> None:
    rig = preset_rig("nuscenes")
    near = [changed(rig, focal=1.004), changed(rig, metres=0.06), changed(rig, degrees=0.3)]
    assert distinct_rigs([rig, *near, rig]) == (rig,)
    other = [
        changed(rig, focal=1.05),
        changed(rig, metres=-0.2),
        changed(rig, degrees=2),
        raised(rig, 0.3),
        preset_rig("waymo"),
    ]
    assert distinct_rigs([rig, *other, rig]) == (rig, *other)
    fewer = distinct_rigs([changed(rig, metres=0.15 * i) for i in range(30)], most=4)
    assert 2 <= len(fewer) <= 4 and fewer[0]["CAM_BACK_RIGHT"].ego_from_cam.allclose(rig["CAM_BACK_RIGHT"].ego_from_cam)
    assert len(distinct_rigs([preset_rig("waymo"), rig, preset_rig("lyft1")], most=1)) == 3, "other cameras are never alike"


def test_gathered_from_recordings(tiny_recording: Path, tmp_path: Path) -> None:
    recording = open_recording(tiny_recording)
    augment = AugmentOptions(ImageAugmentation(max_rotation_deg=2.0), half_turn_probability=0.1)
    found = gather_training_rigs([recording, recording], SIZE, augment)
    (rig,) = found.rigs
    assert list(rig) == list(recording[0].rig) and set(rig) == set(CAMERAS)
    assert (found.focal, found.novel_views, found.max_rotation_deg, found.half_turn_probability) == (None, None, 2.0, 0.1)
    folder = tmp_path / "gaussians"
    folder.mkdir()
    (folder / "scenes.json").write_text("{}")
    views = NovelViews(NovelViewOptions(0.25), GaussianFolder(folder))
    found = gather_training_rigs([recording], SIZE, augment, FocalAugmentation(0.9, 1.1), views)
    assert found.focal == FocalAugmentation(0.9, 1.1) and found.novel_views == NovelViewOptions(0.25)


def test_a_checkpoint_knows_what_it_was_trained_through(tiny_recording: Path, tmp_path: Path) -> None:
    options = TrainOptions(steps=1, batch_size=1, workers=0, warmup_steps=0)
    method_options = CoIn3DOptions(focal=FocalAugmentation(0.8, 1.2))
    weights = train(
        [tiny_recording],
        tmp_path / "run",
        detector="bevdepth",
        config=CONFIG,
        method="coin3d",
        method_options=method_options,
        class_map=THREE_CLASS,
        options=options,
        progress=lambda line: None,
    )
    known = rigs_of_description(read_description(weights), "here")
    assert known is not None and [set(rig) for rig in known.rigs] == [set(CAMERAS)]
    assert known.size_px == (CONFIG.image_width_px, CONFIG.image_height_px)
    assert known.focal == FocalAugmentation(0.8, 1.2) and known.max_rotation_deg == options.augment.image.max_rotation_deg


def test_checkpoints_that_do_not_know() -> None:
    old = describe("bevdepth", CONFIG, ("car",), "coin3d", CoIn3DOptions(novel_views=NovelViewOptions()))
    assert rigs_of_description(old, "old") is None
    named = named_rigs([preset_rig("waymo")], old, "old")
    assert named.size_px == (CONFIG.image_width_px, CONFIG.image_height_px) and named.focal == FocalAugmentation()
    assert named.novel_views == NovelViewOptions() and named.max_rotation_deg == 0
    plain = describe("bevdepth", CONFIG, ("car",), "none", METHODS["none"][0]())
    assert named_rigs([preset_rig("waymo")], plain, "old").focal is None
    for bad, message in (
        ({**old, "config": {}}, "old: the checkpoint does not say the size"),
        ({**old, "method": "magic"}, "old: made with the method 'magic'"),
        ({**old, "options": {"placement": "nowhere"}}, "old: .*placement"),
    ):
        with pytest.raises(ValueError, match=message):
            named_rigs([preset_rig("waymo")], bad, "old")


DAMAGE: list[tuple[Any, str]] = [
    (None, "must be a set of fields"),
    ({}, "rigs is a list"),
    ({"rigs": [], "size_px": [704, 256]}, "there are no training rigs"),
    ({"rigs": [{}] * 65, "size_px": [704, 256]}, "up to 64"),
    ({"rigs": [{"cameras": {"a": {"size": [4, 4]}}}], "size_px": [704, 256]}, "camera 'a'"),
    ({**FULL.plain(), "size_px": [704]}, "holds 2 values"),
    ({**FULL.plain(), "size_px": [704, 10**9]}, "16384 pixels a side"),
    ({**FULL.plain(), "size_px": ["704", "256"]}, "of kind int"),
    ({**FULL.plain(), "half_turn_probability": 1.5}, "probability in"),
    ({**FULL.plain(), "max_rotation_deg": float("nan")}, "turn by 0 to 180"),
    ({**FULL.plain(), "focal": {"min_ratio": 2.0}}, "focal ratios are"),
    ({**FULL.plain(), "wheels": 4}, "no field wheels"),
]


@pytest.mark.parametrize(("data", "message"), DAMAGE)
def test_damage_is_told_with_the_file(data: Any, message: str) -> None:
    with pytest.raises(ValueError, match=f"m.safetensors: the training rigs in the checkpoint are damaged: .*{message}"):
        rigs_of_description({DESCRIPTION_KEY: data}, "m.safetensors")


def test_no_rigs_at_all() -> None:
    with pytest.raises(ValueError, match="no training rigs"):
        replace(FULL, rigs=())
