"""CenterPoint head: targets by hand, losses, and boxes that survive encoding and decoding."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from coin3d.detectors.center_decode import DecodeOptions, decode_centers
from coin3d.detectors.center_head import REGRESSIONS, CenterHead
from coin3d.detectors.center_targets import CenterTargets, center_losses, center_targets, focal_loss, gaussian_radius
from coin3d.detectors.lift_splat import BevGrid
from coin3d.geometry import Boxes3D

GRID = BevGrid(half_extent_m=12.8, cell_m=0.8)
CLASSES = ("car", "pedestrian")


def one(centre: tuple[float, float, float], yaw: float = 0.0, label: str = "car") -> Boxes3D:
    return Boxes3D.create([centre], [(4.0, 1.6, 1.5)], [yaw], [label])


def ideal_outputs(targets: CenterTargets) -> dict[str, Tensor]:
    """Head outputs that say exactly what the targets want; logits far from saturation."""
    samples, _, side, _ = targets.heatmap.shape
    outputs = {"heatmap": torch.logit(targets.heatmap.clamp(1e-4, 1 - 1e-4))}
    start = 0
    for name, channels in REGRESSIONS.items():
        flat = torch.zeros(samples, channels, side * side)
        flat[targets.sample, :, targets.cell] = targets.values[:, start : start + channels]
        outputs[name] = flat.reshape(samples, channels, side, side)
        start += channels
    return outputs


def test_targets_by_hand() -> None:
    boxes = Boxes3D.concatenate([one((1.0, -3.0, 0.75), yaw=0.5), one((-12.8, 12.7, 0.2), label="pedestrian")])
    targets = center_targets([Boxes3D.empty(), boxes], CLASSES, GRID)
    # x: (1 + 12.8) / 0.8 = 17.25; y: (-3 + 12.8) / 0.8 = 12.25; the pedestrian sits in column 0, row 31
    assert targets.sample.tolist() == [1, 1]
    assert targets.cell.tolist() == [12 * 32 + 17, 31 * 32]
    car = [0.25, 0.25, 0.75, np.log(4.0), np.log(1.6), np.log(1.5), np.sin(0.5), np.cos(0.5)]
    np.testing.assert_allclose(targets.values[0].numpy(), car, atol=1e-6)
    assert (targets.heatmap == 1).nonzero().tolist() == [[1, 0, 12, 17], [1, 1, 31, 0]]
    assert not targets.heatmap[0].any()


def test_peak_by_hand() -> None:
    peak = center_targets([one((0.4, 0.4, 0.0))], CLASSES, GRID, min_radius_cells=2, min_overlap=0.9).heatmap[0, 0]
    # radius 2: sigma = 5 / 6, so one cell away exp(-0.72), cut at two cells
    assert peak[16, 16] == 1
    assert peak[16, 17] == peak[15, 16] == pytest.approx(np.exp(-0.72))
    assert peak[14, 18] == pytest.approx(np.exp(-0.72 * 8))
    assert not peak[16, 19] and not peak[13].any()
    assert int((peak > 0).sum()) == 25


def test_neighbouring_peaks_keep_the_larger_value() -> None:
    first, second = one((0.4, 0.4, 0)), one((2.0, 0.4, 0))
    alone = [center_targets([b], CLASSES, GRID).heatmap for b in (first, second)]
    together = center_targets([Boxes3D.concatenate([first, second])], CLASSES, GRID).heatmap
    assert torch.equal(together, torch.maximum(*alone))


def test_radius_by_hand() -> None:
    # a 5 x 2 cell car at overlap 0.1, the three cases of the quadratic by hand:
    # (7 + sqrt(49 - 4 * 10 * 0.9 / 1.1)) / 2, (14 + sqrt(196 - 16 * 9)) / 2, (-1.4 + sqrt(1.96 + 1.6 * 9)) / 2
    cases = [(7 + np.sqrt(49 - 36 / 1.1)) / 2, (14 + np.sqrt(52)) / 2, (-1.4 + np.sqrt(16.36)) / 2]
    assert gaussian_radius(5, 2, 0.1) == pytest.approx(min(cases)) == pytest.approx(1.3224, abs=1e-4)
    assert gaussian_radius(2, 5, 0.1) == gaussian_radius(5, 2, 0.1)


@pytest.mark.parametrize("place", [(12.8, 0.0), (-12.81, 0.0), (0.0, 13.0), (0.0, -12.9)])
def test_boxes_off_the_map_and_other_classes_are_left_out(place: tuple[float, float]) -> None:
    outside, other = one((*place, 0.0)), one((0, 0, 0), label="tree")
    targets = center_targets([Boxes3D.concatenate([outside, other])], CLASSES, GRID)
    assert len(targets.cell) == 0 and targets.values.shape == (0, 8) and not targets.heatmap.any()
    losses = center_losses(ideal_outputs(targets), targets)
    assert all(torch.isfinite(loss) for loss in losses.values())
    assert all(losses[name] == 0 for name in REGRESSIONS)


def test_targets_move_to_a_device() -> None:
    moved = center_targets([one((0, 0, 0))], CLASSES, GRID).to("meta")
    assert {t.device.type for t in (moved.heatmap, moved.sample, moved.cell, moved.values)} == {"meta"}


def test_focal_loss_by_hand() -> None:
    target = torch.tensor([[[[1.0, 0.5, 0.0]]]])
    logits = torch.logit(torch.tensor([[[[0.8, 0.3, 0.1]]]]))
    expected = -(0.2**2) * np.log(0.8) - 0.3**2 * np.log(0.7) * 0.5**4 - 0.1**2 * np.log(0.9)
    assert float(focal_loss(logits, target)) == pytest.approx(expected, rel=1e-5)
    # two peaks: per positive
    twice = focal_loss(logits.repeat(2, 1, 1, 1), target.repeat(2, 1, 1, 1))
    assert float(twice) == pytest.approx(expected, rel=1e-5)


def test_regression_losses_by_hand() -> None:
    targets = center_targets([one((0.4, 0.4, 1.0)), one((4.4, 0.4, 1.0))], CLASSES, GRID)
    outputs = ideal_outputs(targets)
    outputs["height"] = outputs["height"] + 0.25  # off by 0.25 at both objects
    outputs["heading"][1, 0] += 0.5  # off by 0.5 in the sine of the second
    reordered = {name: outputs[name] for name in reversed(list(outputs))}  # an order of a dictionary means nothing
    for some in (outputs, reordered):
        losses = {name: float(loss) for name, loss in center_losses(some, targets).items()}
        assert losses["height"] == pytest.approx(1.5 * 0.25, rel=1e-3)
        assert losses["heading"] == pytest.approx(1.5 * 0.25, rel=1e-3)
        assert losses["size"] == losses["offset"] == 0


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.integers(0, 6))
def test_encoding_then_decoding_gives_the_boxes_back(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    # one box per block of 4 m, far enough from its borders for boxes never to overlap
    blocks = rng.permutation(36)[:count]
    centre = np.column_stack([blocks // 6, blocks % 6, rng.uniform(-2, 1, count)]) * (4.0, 4.0, 1.0)
    centre[:, :2] += rng.uniform(-0.5, 0.5, (count, 2)) - 10.0
    size = rng.uniform((0.5, 0.4, 1.0), (2.0, 1.2, 2.0), (count, 3))
    labels = rng.choice(CLASSES, count)
    truth = Boxes3D.create(centre, size, rng.uniform(-np.pi, np.pi, count), labels)
    targets = center_targets([truth, Boxes3D.empty()], CLASSES, GRID, min_radius_cells=1)
    found, none = decode_centers(ideal_outputs(targets), CLASSES, GRID, DecodeOptions(min_score=0.9))
    assert len(none) == 0
    assert len(found) == count
    if not count:
        return
    nearest = np.linalg.norm(truth.centre_m[:, None] - found.centre_m[None], axis=-1).argmin(1)
    assert sorted(nearest.tolist()) == list(range(count))
    found = found[nearest]
    assert found.labels.tolist() == truth.labels.tolist()
    np.testing.assert_allclose(found.centre_m, truth.centre_m, atol=1e-5)
    np.testing.assert_allclose(found.size_m, truth.size_m, rtol=1e-5)
    np.testing.assert_allclose(np.cos(found.yaw_rad - truth.yaw_rad), 1, atol=1e-9)
    np.testing.assert_allclose(found.scores, 1, atol=2e-4)


def test_decoding_by_hand() -> None:
    outputs = {name: torch.zeros(1, channels, 32, 32) for name, channels in REGRESSIONS.items()}
    outputs["heatmap"] = torch.full((1, 2, 32, 32), -9.0)
    outputs["heatmap"][0, 1, 3, 20] = 2.0
    outputs["heatmap"][0, 0, 30, 1] = 0.0
    outputs["offset"][0, :, 3, 20] = torch.tensor([0.5, 1.25])  # offsets may leave the cell
    outputs["height"][0, 0, 3, 20] = -0.4
    outputs["size"][0, :, 3, 20] = torch.tensor([0.0, np.log(0.5), 100.0])  # an absurd height is held
    outputs["heading"][0, :, 3, 20] = torch.tensor([3.0, 0.0])  # sine, cosine; length does not matter
    outputs["heading"][0, 1] += torch.where(outputs["heading"][0, 0] == 0, 1.0, 0.0)
    (boxes,) = decode_centers(outputs, CLASSES, GRID, DecodeOptions(min_score=0.1))
    assert boxes.labels.tolist() == ["pedestrian", "car"]  # best first
    np.testing.assert_allclose(boxes.scores, [1 / (1 + np.exp(-2)), 0.5], rtol=1e-6)
    np.testing.assert_allclose(boxes.centre_m[0], [20.5 * 0.8 - 12.8, 4.25 * 0.8 - 12.8, -0.4], atol=1e-5)
    np.testing.assert_allclose(boxes.size_m[0], [1.0, 0.5, np.exp(5)], rtol=1e-5)
    np.testing.assert_allclose(boxes.yaw_rad, [np.pi / 2, 0], atol=1e-6)


def test_limits_of_decoding() -> None:
    outputs = {name: torch.zeros(1, channels, 32, 32) for name, channels in REGRESSIONS.items()}
    outputs["size"] -= 3.0  # 5 cm boxes: none overlap
    outputs["heatmap"] = torch.arange(1024.0).reshape(1, 1, 32, 32) / 1024
    every = decode_centers(outputs, ("car",), GRID, DecodeOptions(max_boxes=5000, max_kept=5000))[0]
    assert len(every) == 1024
    assert len(decode_centers(outputs, ("car",), GRID, DecodeOptions(max_boxes=40))[0]) == 40
    fewer = decode_centers(outputs, ("car",), GRID, DecodeOptions(max_kept=7))[0]
    np.testing.assert_array_equal(fewer.centre_m, every.centre_m[:7])
    assert len(decode_centers(outputs, ("car",), GRID, DecodeOptions(min_score=0.8))[0]) == 0


def test_fresh_head_predicts_the_usual_prior() -> None:
    torch.manual_seed(0)
    with torch.no_grad():
        outputs = CenterHead(8, 2, 16).eval()(torch.zeros(1, 8, 16, 16))
    assert {name: value.shape[1] for name, value in outputs.items()} == {**REGRESSIONS, "heatmap": 2}
    assert float(outputs["heatmap"].sigmoid().mean()) == pytest.approx(0.1, abs=0.02)


def test_small_classes_may_stand_close() -> None:
    """Two 1.4 m squares 0.9 m apart overlap by 0.7 of 3.22 square metres, at 0.7 of their size by 0.078 of 1.84."""
    pairs = [
        Boxes3D.create([(0.4, 0.4 + y, 1.0), (1.3, 0.4 + y, 1.0)], [(1.4, 1.4, 1.7)] * 2, [0, 0], [label] * 2)
        for label, y in (("car", 0.0), ("pedestrian", 8.0))
    ]
    outputs = ideal_outputs(center_targets([Boxes3D.concatenate(pairs)], CLASSES, GRID, min_radius_cells=1))
    for factors, expected in (((), 2), ((1.0, 0.7), 3), ((0.7, 0.7), 4)):
        options = DecodeOptions(min_score=0.9, nms_size_factors=factors)
        (found,) = decode_centers(outputs, CLASSES, GRID, options)
        assert len(found) == expected
        np.testing.assert_allclose(found.size_m, [(1.4, 1.4, 1.7)] * expected, rtol=1e-5)
