"""BEVFormer-tiny with the released weights' conventions, stage by stage, for a first frame and one with history."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import torch
from bevformer_released import CLASSES, CONFIG, released_batch, released_model
from parity_files import fixture
from torch import Tensor

from coin3d.detectors.pillar_projection import image_from_bev, pillar_anchors, project_pillars
from coin3d.detectors.query_boxes import decode_queries
from coin3d.detectors.query_losses import query_losses, query_targets
from coin3d.geometry import Boxes3D
from coin3d.training.released.box_rows import our_box_rows

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
    lidar_from_ego = torch.from_numpy(CONFIG.released.lidar.ego_from_lidar.inverse().matrix.copy())[None]
    ours = image_from_bev(batch.cameras, lidar_from_ego, batch.sample_index, CONFIG.released.first_pixel)
    assert error(ours, stored()["lidar2img"][:, :3]) < 1e-6


@pytest.mark.parametrize("frame", FRAMES)
def test_birds_eye_view(frame: str) -> None:
    assert error(outputs(frame)["bev"].transpose(0, 1), stored()[f"bev{frame}"]) < 1e-5


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("layer", range(6))
def test_decoder_layers(frame: str, layer: int) -> None:
    result = outputs(frame)
    codes = torch.from_numpy(stored()[f"box{frame}"][layer]).movedim(-1, 0)
    in_our_coding = our_box_rows(codes, "width-length").movedim(0, -1)
    assert error(result["class_logits"][layer], stored()[f"cls{frame}"][layer]) < 1e-4
    assert error(result["boxes"][layer], in_our_coding.numpy()) < 1e-4


def table(rows: np.ndarray, labels: np.ndarray, scores: np.ndarray | None = None, *, bottom: bool = False) -> Boxes3D:
    """Released boxes (x, y, z of the centre or bottom, width, length, height, yaw, velocity) as ours, in the same frame."""
    rows = rows.astype(np.float64)
    centre = rows[:, :3] + [0, 0, 0.5 * bottom] * rows[:, 5:6]
    names = np.array(CLASSES)[labels]
    yaw_rad = -rows[:, 6] - np.pi / 2
    return Boxes3D.create(centre, rows[:, [4, 3, 5]], yaw_rad, names, scores=scores, velocity_mps=rows[:, 7:])


def test_losses() -> None:
    result = outputs("1")
    targets = [query_targets(table(stored()["gt"], stored()["labels"], bottom=True), CLASSES, CONFIG.box_space)]
    ours = query_losses(result["class_logits"], result["boxes"], targets, CONFIG.weights)
    theirs = dict(zip(stored()["loss_names"].tolist(), stored()["loss_vals"].tolist(), strict=True))
    for layer in range(1, 7):
        prefix = "" if layer == 6 else f"d{layer - 1}."
        assert float(ours[f"class_{layer}"]) == pytest.approx(theirs[f"{prefix}loss_cls"], rel=5e-4), layer
        assert float(ours[f"box_{layer}"]) == pytest.approx(theirs[f"{prefix}loss_bbox"], rel=5e-4), layer


def test_decoded_boxes() -> None:
    result = outputs("1")
    (ours,) = decode_queries(result["class_logits"][-1], result["boxes"][-1], CLASSES, CONFIG.decode)
    theirs = table(stored()["dec_boxes"], stored()["dec_labels"], stored()["dec_scores"])
    assert len(ours) == len(theirs) == 300
    np.testing.assert_allclose(np.sort(ours.scores), np.sort(theirs.scores), atol=1e-5)

    def columns(boxes: Boxes3D) -> np.ndarray:
        parts = (boxes.centre_m, boxes.size_m, np.cos(boxes.yaw_rad), np.sin(boxes.yaw_rad), boxes.velocity_mps)
        return np.column_stack(parts)

    for box, label in zip(columns(theirs), theirs.labels, strict=True):  # as sets: scores tie at saturation
        same_class = columns(ours)[ours.labels == label]
        assert np.abs(same_class - box).max(1).min() < 2e-3


def test_history_matters() -> None:
    """The two frames differ only by history and the numbers of the bus."""
    assert error(outputs("1")["bev"].transpose(0, 1), stored()["bev2"]) > 0.1
