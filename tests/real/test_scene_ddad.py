"""Gaussians of real frames through the poses of the next one: poses that are wrong anywhere would show."""

from itertools import pairwise
from pathlib import Path

import numpy as np

from coin3d.datasets.frame import Frame
from coin3d.datasets.open import open_recording
from coin3d.geometry import Pose
from coin3d.rendering import Gaussians, load_gaussians, render
from coin3d.scenes.build import build_scenes
from coin3d.scenes.options import BuildOptions
from coin3d.scenes.views import load_views

WIDTH_PX = 240


def psnr_db(gaussians: Gaussians, later: Frame, now_from_later: Pose) -> float:
    """Mean over the cameras, of covered pixels."""
    found = []
    for view in load_views(later, WIDTH_PX):
        (image,) = render(gaussians, [view.camera.moved(now_from_later @ view.camera.ego_from_cam)])
        covered = image.alpha > 0.5
        found.append(10 * np.log10(255**2 / ((image.rgb.astype(float) - view.rgb) ** 2).mean(-1)[covered].mean()))
    return float(np.mean(found))


def test_a_frame_predicts_the_next(ddad_three_frames: Path, tmp_path: Path) -> None:
    frames = list(open_recording(ddad_three_frames))
    outcome = build_scenes(
        open_recording(ddad_three_frames), tmp_path, BuildOptions(width_px=WIDTH_PX), progress=lambda line: None
    )
    assert all(frame.psnr_db > 18 and frame.empty_below_horizon < 0.02 for frame in outcome.frames)
    for now, later in pairwise(frames):
        gaussians = load_gaussians(tmp_path / now.scene / f"{now.token}.safetensors")
        drive = now.world_from_ego.inverse() @ later.world_from_ego
        assert np.linalg.norm(drive.translation) > 1
        right = psnr_db(gaussians, later, drive)
        half = Pose(drive.rotation, drive.translation / 2)
        assert right > psnr_db(gaussians, later, half) + 0.3, "half the drive is worse"
        assert right > 14.5  # exposures differ between the cameras, and leaves do not meet
