"""Targets, losses and decoding of the released CenterPoint head, and its depth supervision."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from parity_files import fixture
from torch import Tensor

from coin3d.detectors.center_decode import DecodeOptions, decode_centers
from coin3d.detectors.center_targets import CenterTargets, center_losses, center_targets
from coin3d.detectors.depth_loss import depth_loss
from coin3d.detectors.lift_splat import BevGrid, DepthBins
from coin3d.detectors.nms import rotated_nms
from coin3d.geometry import Boxes3D

CAR_FILES = ["coin3d_det_nus6_128x352.npz", "coin3d_det_nus6_trainpath_128x352.npz", "coin3d_det_waymo5_b2_128x352.npz"]
THREE_CLASSES = "coin3d_head_3cls.npz"
CLASSES = ("car", "pedestrian", "two-wheel")
RELEASED_NAMES = {"offset": "reg", "height": "height", "size": "dim", "heading": "rot", "heatmap": "heatmap"}
RELEASED_LOSSES = {"offset": "xy", "height": "z", "size": "whl", "heading": "yaw", "heatmap": "heatmap"}
NMS_SIZE_FACTORS = np.array([1.0, 0.7, 0.7])
"""The released head shrinks pedestrians and two-wheelers before it suppresses, and restores them after; ours does not."""

Stored = dict[str, np.ndarray]


@pytest.fixture(params=[*CAR_FILES, THREE_CLASSES])
def stored(request: pytest.FixtureRequest) -> Stored:
    return fixture(request.param)


@pytest.fixture(params=CAR_FILES)
def car_stored(request: pytest.FixtureRequest) -> Stored:
    return fixture(request.param)


def table(values: np.ndarray, labels: np.ndarray, scores: np.ndarray | None = None) -> Boxes3D:
    return Boxes3D.create(values[:, :3], values[:, 3:6], values[:, 6], [CLASSES[i] for i in labels], scores=scores)


def truth(stored: Stored) -> list[Boxes3D]:
    """Ground truth of each sample, class by class: the released head groups its boxes so before it fills its slots."""
    order = np.argsort(stored["gt_labels"], axis=1, kind="stable")
    pairs = zip(stored["gt_center_boxes"], stored["gt_labels"], order, strict=True)
    return [table(boxes[rows], labels[rows]) for boxes, labels, rows in pairs]


def targets(stored: Stored) -> CenterTargets:
    return center_targets(truth(stored), CLASSES[: stored["head_heatmap"].shape[1]], BevGrid())


def head_outputs(stored: Stored) -> dict[str, Tensor]:
    return {ours: torch.from_numpy(stored[f"head_{theirs}"]) for ours, theirs in RELEASED_NAMES.items()}


def test_regression_targets_and_cells(stored: Stored) -> None:
    ours, used = targets(stored), stored["tgt_mask"].astype(bool)
    assert 0 < used.sum() < used.size  # one box lies outside the map
    np.testing.assert_array_equal(ours.sample.numpy(), np.nonzero(used)[0])
    np.testing.assert_array_equal(ours.cell.numpy(), stored["tgt_ind"][used])
    np.testing.assert_allclose(ours.values.numpy(), stored["tgt_anno"][used], atol=1e-5)


def test_heat_map(car_stored: Stored) -> None:
    ours = targets(car_stored).heatmap.numpy()
    np.testing.assert_array_equal(ours == 0, car_stored["tgt_heatmap"] == 0)  # the same radius at every centre
    np.testing.assert_allclose(ours, car_stored["tgt_heatmap"], atol=1e-6)


def test_losses(car_stored: Stored) -> None:
    ours = center_losses(head_outputs(car_stored), targets(car_stored))
    names = [str(name).removeprefix("task0.loss_") for name in car_stored["loss_names"]]
    theirs = dict(zip(names, car_stored["loss_vals"], strict=True))
    assert set(RELEASED_LOSSES) == set(ours)
    for name, value in ours.items():
        assert float(value) == pytest.approx(theirs[RELEASED_LOSSES[name]], rel=1e-5), name


def sorted_rows(boxes: Boxes3D) -> np.ndarray:
    """One row per box, in an order that does not depend on ties between scores."""
    rows = np.column_stack([boxes.centre_m, boxes.size_m, np.cos(boxes.yaw_rad), np.sin(boxes.yaw_rad), boxes.scores])
    return rows[np.lexsort((np.round(rows[:, 0], 3), np.round(rows[:, 1], 3), boxes.labels))]


def test_best_cells_become_boxes(stored: Stored) -> None:
    outputs, kinds = head_outputs(stored), CLASSES[: stored["head_heatmap"].shape[1]]
    never = 1.1  # no overlap reaches it: suppression takes nothing away
    ours = decode_centers(outputs, kinds, BevGrid(), DecodeOptions(nms_iou=never))
    for b, boxes in enumerate(ours):
        theirs = table(stored[f"pre_boxes{b}"], stored[f"pre_labels{b}"], stored[f"pre_scores{b}"])
        assert len(boxes) == len(theirs) == 500
        np.testing.assert_allclose(boxes.scores, np.sort(theirs.scores)[::-1], atol=1e-6)
        np.testing.assert_allclose(sorted_rows(boxes), sorted_rows(theirs), atol=2e-5)


def test_suppression(stored: Stored) -> None:
    for b in range(len(stored["gt_labels"])):
        labels, values = stored[f"pre_labels{b}"], stored[f"pre_boxes{b}"].astype(np.float64)
        factor = NMS_SIZE_FACTORS[labels][:, None]
        shrunk = table(
            np.column_stack([values[:, :3], values[:, 3:6] * factor, values[:, 6]]), labels, stored[f"pre_scores{b}"]
        )
        kept = rotated_nms(shrunk, 0.2)
        ours = table(values[kept], labels[kept], stored[f"pre_scores{b}"][kept])
        theirs = stored[f"nms_boxes{b}"].astype(np.float64)
        theirs[:, 2] += theirs[:, 5] / 2  # the released code returns the bottom
        expected = table(theirs, stored[f"nms_labels{b}"], stored[f"nms_scores{b}"])
        assert 0 < len(values) - len(kept) < 20
        np.testing.assert_allclose(sorted_rows(ours), sorted_rows(expected), atol=2e-5)


def sparse_depth(stored: Stored) -> Tensor:
    height, width = stored["size"]
    cameras = stored["gt_depth_bins"].shape[:2]
    depth_m = np.zeros((*cameras, height, width), dtype=np.float32)
    depth_m[tuple(stored["gt_depth_idx"].T)] = stored["gt_depth_val"]
    return torch.from_numpy(depth_m.reshape(-1, height, width))


def test_depth_supervision(car_stored: Stored) -> None:
    """The nearest return of a block decides its bin: a loss of log probabilities tells which bins we supervise."""
    depth_m, expected = sparse_depth(car_stored), torch.from_numpy(car_stored["gt_depth_bins"]).flatten(0, 1).long()
    bins = DepthBins()
    # with these logits the loss has a gradient exactly at the supervised cells, negative only at the true bin
    logits = torch.zeros(len(depth_m), bins.count, *expected.shape[-2:], requires_grad=True)
    depth_loss(logits, depth_m, bins, 16).backward()
    assert logits.grad is not None
    supervised = logits.grad.abs().sum(1) > 0
    assert torch.equal(torch.where(supervised, logits.grad.argmin(1), -1), expected)


@pytest.mark.parametrize("name", CAR_FILES[:2])  # the third stores every second bin only
def test_depth_loss(name: str) -> None:
    stored = fixture(name)
    probability = torch.from_numpy(stored["depth_key"])
    loss = depth_loss(probability.log(), sparse_depth(stored), DepthBins(), 16)
    assert float(loss) == pytest.approx(float(stored["loss_depth"]), rel=1e-5)
