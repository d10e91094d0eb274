"""Moving a bird's-eye view with the vehicle."""

import math

import torch

from coin3d.detectors.bev_warp import warp_bev
from coin3d.detectors.lift_splat import BevGrid

GRID = BevGrid(half_extent_m=8.0, cell_m=1.0)


def pose(x_m: float, y_m: float, yaw_rad: float = 0.0) -> torch.Tensor:
    out = torch.eye(4)[None]
    out[0, :2, :2] = torch.tensor([[math.cos(yaw_rad), -math.sin(yaw_rad)], [math.sin(yaw_rad), math.cos(yaw_rad)]])
    out[0, 0, 3], out[0, 1, 3] = x_m, y_m
    return out


def test_driving_forward_moves_what_stands_backward() -> None:
    bev = torch.zeros(1, 1, 16, 16)
    bev[0, 0, 8, 13] = 1.0  # x = 5.5 m, y = 0.5 m
    moved = warp_bev(bev, pose(3.0, 0.0), GRID)  # the vehicle stands 3 m further on now
    assert moved[0, 0, 8, 10] == 1.0 and moved.sum() == 1.0


def test_a_quarter_turn_is_exact_about_the_vehicle() -> None:
    bev = torch.rand(1, 3, 16, 16, generator=torch.Generator().manual_seed(0))
    moved = warp_bev(bev, pose(0.0, 0.0, math.pi / 2), GRID)  # forward is now where left was
    torch.testing.assert_close(moved, torch.rot90(bev, 1, (2, 3)), atol=1e-5, rtol=0)


def test_nothing_is_invented_outside() -> None:
    moved = warp_bev(torch.ones(1, 1, 16, 16), pose(100.0, 0.0), GRID)
    assert not moved.any()


def test_places_are_exact_in_half_precision() -> None:
    """A shift by half a cell of 128 would be lost where places themselves are rounded to half precision."""
    grid = BevGrid(half_extent_m=64.0, cell_m=1.0)
    bev = torch.zeros(1, 1, 128, 128)
    bev[0, 0, 3, 120] = 1.0
    with torch.autocast("cpu", dtype=torch.bfloat16):
        moved = warp_bev(bev.bfloat16(), pose(0.5, 0.0), grid)
    assert moved.dtype == torch.bfloat16
    assert moved[0, 0, 3, 119:121].tolist() == [0.5, 0.5]
