"""BEVFormer-tiny with the released weights' conventions, stage by stage, for a first frame and one with history."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import torch
from bevformer_released import CONFIG, released_batch, released_model
from parity_files import fixture
from torch import Tensor

from coin3d.detectors.pillar_projection import image_from_bev, pillar_anchors, project_pillars
from coin3d.training.released.bevformer_keys import box_rows

torch.set_num_threads(1)
FRAMES = ("1", "2")


@cache
def stored() -> dict[str, np.ndarray]:
    return fixture("bevformer_tiny_96x160.npz")


@cache
def outputs(frame: str) -> dict[str, Tensor]:
    """The second frame has the first one's stored bird's-eye view as history, so that its errors are its own."""
    history = torch.from_numpy(stored()["bev1"]).transpose(0, 1) if frame == "2" else None
    bus = torch.from_numpy(stored()[f"can_bus{frame}"]).float()[None]
    with torch.inference_mode():
        result: dict[str, Tensor] = released_model()(released_batch(stored()["lidar2img"]), previous_bev=history, bus=bus)
    return result


def error(ours: Tensor, theirs: np.ndarray) -> float:
    """Largest difference relative to the largest value."""
    expected = torch.from_numpy(theirs)
    assert ours.shape == expected.shape
    return float((ours - expected).abs().max() / expected.abs().max())


def test_image_features() -> None:
    model, images = released_model(), released_batch(stored()["lidar2img"]).images
    with torch.inference_mode():
        c5 = model.backbone(images)
        p5 = model.neck(c5)
    assert error(c5[0][:, ::32], stored()["c5"]) < 2e-5
    assert error(p5[None], stored()["p5"]) < 2e-5


def test_projected_pillars() -> None:
    anchors, batch = pillar_anchors(CONFIG.grid, CONFIG.anchor_heights_m), released_batch(stored()["lidar2img"])
    views = project_pillars(anchors, torch.from_numpy(stored()["lidar2img"][:, :3]), (96, 160))
    expected, visible = torch.from_numpy(stored()["ref_cam"])[:, 0], torch.from_numpy(stored()["bev_mask"])[:, 0]
    assert torch.equal(views.visible, visible)
    assert error(views.references, expected.numpy()) < 1e-6
    assert (views.references - expected)[visible].abs().max() < 1e-6
    # the same through our cameras, whose poses and pixels have other origins
    assert CONFIG.released is not None
    lidar_from_ego = torch.from_numpy(CONFIG.released.ego_from_lidar.inverse().matrix.copy())[None]
    ours = image_from_bev(batch.cameras, lidar_from_ego, batch.sample_index, CONFIG.released.first_pixel)
    assert error(ours, stored()["lidar2img"][:, :3]) < 1e-6


@pytest.mark.parametrize("frame", FRAMES)
def test_birds_eye_view(frame: str) -> None:
    assert error(outputs(frame)["bev"].transpose(0, 1), stored()[f"bev{frame}"]) < 1e-5


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("layer", range(6))
def test_decoder_layers(frame: str, layer: int) -> None:
    result = outputs(frame)
    in_our_coding = box_rows(torch.from_numpy(stored()[f"box{frame}"][layer]).movedim(-1, 0)).movedim(0, -1)
    assert error(result["class_logits"][layer], stored()[f"cls{frame}"][layer]) < 1e-4
    assert error(result["boxes"][layer], in_our_coding.numpy()) < 1e-4


def test_history_matters() -> None:
    """The two frames differ only by history and the numbers of the bus."""
    assert error(outputs("1")["bev"].transpose(0, 1), stored()["bev2"]) > 0.1
