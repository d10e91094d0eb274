"""Gaussians of a real key frame with a single sweep."""

from pathlib import Path

import numpy as np

from coin3d.datasets.open import open_recording
from coin3d.geometry import Pose
from coin3d.rendering import load_gaussians, render
from coin3d.scenes.build import build_scenes
from coin3d.scenes.options import BuildOptions
from coin3d.scenes.views import shrink


def test_one_sweep_makes_a_street_that_can_be_looked_at_from_elsewhere(one_real_frame: Path, tmp_path: Path) -> None:
    recording = open_recording(one_real_frame)
    outcome = build_scenes(recording, tmp_path, BuildOptions(width_px=320), progress=lambda line: None)
    (quality,) = outcome.frames
    assert quality.psnr_db > 22
    assert quality.empty_below_horizon < 0.02
    assert quality.known_below_horizon > 0.4
    assert 0.02 < quality.sky < 0.2
    frame = recording[0]
    gaussians = load_gaussians(tmp_path / frame.scene / f"{frame.token}.safetensors")
    lower = [
        shrink(c.moved(Pose(c.ego_from_cam.rotation, c.ego_from_cam.translation - np.array([0, 0, 0.5]))), 320)
        for c in frame.rig.values()
    ]
    below = [image.alpha[image.alpha.shape[0] // 2 :] for image in render(gaussians, lower)]
    assert np.mean([(alpha > 0.5).mean() for alpha in below]) > 0.97
