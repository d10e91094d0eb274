"""LiDAR as a teacher of depth: bins, projection with a z-buffer, the nearest return of a block, the loss."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from coin3d.detectors.depth_loss import depth_loss
from coin3d.detectors.inputs import lidar_depth
from coin3d.detectors.lift_splat import DepthBins
from coin3d.geometry import Camera, camera_pose

BINS = DepthBins(1.0, 5.0, 0.5)


def test_bins_by_hand() -> None:
    assert BINS.count == 8
    depth = torch.tensor([0.0, 0.99, 1.0, 1.49, 1.5, 3.25, 4.999, 5.0, 80.0, torch.inf])
    assert BINS.index(depth).tolist() == [-1, -1, 0, 0, 1, 4, 7, -1, -1, -1]
    assert BINS.centres_m().tolist() == [1.25, 1.75, 2.25, 2.75, 3.25, 3.75, 4.25, 4.75]


def test_every_bin_centre_is_in_its_bin() -> None:
    for bins in (DepthBins(), BINS, DepthBins(2.0, 58.0, 0.8), DepthBins(1.0, 60.0, 1.0)):
        assert bins.index(bins.centres_m()).tolist() == list(range(bins.count))
    assert DepthBins().count == 118  # the paper's


def loss_of(probability: torch.Tensor, depth_m: torch.Tensor, weight: float = 1.0) -> float:
    return float(depth_loss(probability.log(), depth_m, BINS, 2, weight))


def test_loss_by_hand() -> None:
    # two blocks of 2 x 2 pixels; the nearest return of the left one is 1.6 m (bin 1), the right one has none
    depth_m = torch.tensor([[[0.0, 3.0, 0.0, 0.0], [1.6, 4.9, 0.0, 0.0]]])
    probability = torch.tensor([0.1, 0.3, 0.2, 0.1, 0.1, 0.1, 0.05, 0.05])
    both = torch.stack([probability, torch.full((8,), 1 / 8)], dim=-1)[None, :, None, :]
    expected = -np.log(0.3) - np.log1p(-np.delete(probability.double().numpy(), 1)).sum()
    assert loss_of(both, depth_m) == pytest.approx(expected, rel=1e-5)
    assert loss_of(both, depth_m, 3.0) == pytest.approx(3 * expected, rel=1e-5)
    # a second supervised block: the mean of the two
    depth_m[0, 0, 3] = 1.2
    second = -np.log(1 / 8) - 7 * np.log(7 / 8)
    assert loss_of(both, depth_m) == pytest.approx((expected + second) / 2, rel=1e-5)


def test_without_returns_in_range_there_is_no_loss() -> None:
    uniform = torch.full((1, 8, 1, 2), 1 / 8)
    assert loss_of(uniform, torch.zeros(1, 2, 4)) == 0
    assert loss_of(uniform, torch.full((1, 2, 4), 70.0)) == 0
    # as in the released code, a nearest return below the first bin leaves its block without supervision
    assert loss_of(uniform, torch.tensor([[[0.5, 3.0, 0, 0], [0, 0, 0, 0]]])) == 0


def test_certain_and_right_costs_nothing_certain_and_wrong_stays_finite() -> None:
    logits = torch.full((1, 8, 1, 1), -200.0)
    logits[0, 4] = 200.0
    assert float(depth_loss(logits, torch.full((1, 2, 2), 3.25), BINS, 2)) == pytest.approx(0, abs=1e-6)
    logits.requires_grad_()
    wrong = depth_loss(logits, torch.full((1, 2, 2), 1.25), BINS, 2)
    wrong.backward()
    assert torch.isfinite(wrong) and logits.grad is not None and torch.isfinite(logits.grad).all()


def test_lidar_by_hand() -> None:
    # level camera at the origin, 1 m up, looking forward: u = 32 - 20 y / x, v = 16 - 20 (z - 1) / x
    K = np.array([[20.0, 0, 32], [0, 20, 16], [0, 0, 1]])
    camera = Camera(K, 64, 32, camera_pose((0.0, 0.0, 1.0)))
    points = np.array(
        [
            [10.0, 0.0, 1.0],  # (32, 16)
            [8.0, -0.1, 0.9],  # (32.25, 16.25): the same pixel, nearer
            [20.0, 5.0, 1.0],  # (27, 16)
            [4.0, 6.39, 1.0],  # (0.05, 16): the leftmost column
            [4.0, 6.41, 1.0],  # (-0.05, 16): outside
            [-5.0, 0.0, 1.0],  # behind
            [0.4, 0.0, 1.0],  # nearer than what counts as seen
        ]
    )
    depth = lidar_depth(points, camera)
    assert depth.shape == (32, 64) and depth.dtype == np.float32
    expected = {(16, 32): 8.0, (16, 27): 20.0, (16, 0): 4.0}
    assert {tuple(at): depth[tuple(at)] for at in np.argwhere(depth).tolist()} == pytest.approx(expected)


def test_order_of_points_does_not_matter() -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-2, 30, 4000), rng.uniform(-10, 10, (4000, 2))])
    camera = Camera(np.array([[20.0, 0, 32], [0, 20, 16], [0, 0, 1]]), 64, 32, camera_pose((0.0, 0.0, 1.0)))
    depth = lidar_depth(points, camera)
    assert np.array_equal(depth, lidar_depth(points[rng.permutation(4000)], camera))
    pixels, z = camera.project(points)
    for v, u in np.argwhere(depth)[::50]:
        here = camera.sees(points) & (np.floor(pixels) == (u, v)).all(-1)
        assert depth[v, u] == np.float32(z[here].min())


def test_no_points() -> None:
    camera = Camera(np.array([[20.0, 0, 32], [0, 20, 16], [0, 0, 1]]), 64, 32, camera_pose((0.0, 0.0, 1.0)))
    assert not lidar_depth(np.zeros((0, 3)), camera).any()
