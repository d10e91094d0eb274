"""Where pixels land in bird's-eye view: by hand, against float64 camera geometry, under augmentation, from the cache."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from coin3d.augmentation import BevAugmentation, transform_boxes
from coin3d.detectors.lift_splat import BevGrid, DepthBins, LiftSplat
from coin3d.geometry import Boxes3D, Camera, GroundPlane, camera_pose, fit_width, preset_rig
from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.geometry.image_transform import flipped, rotated
from small_world import ring_rig

GRID = BevGrid(half_extent_m=25.6, cell_m=0.8)
BINS = DepthBins(1.0, 31.0, 1.0)
STRIDE = 16


def tensors(*cameras: Camera) -> CameraTensors:
    return CameraTensors.from_cameras(cameras, [GroundPlane()] * len(cameras))


def cells(
    *cameras: Camera, bev: np.ndarray | None = None, sample_index: list[int] | None = None, samples: int = 1
) -> torch.Tensor:
    bev_from_ego = torch.from_numpy(np.eye(3) if bev is None else bev).float().expand(samples, 3, 3)
    index = torch.tensor(sample_index or [0] * len(cameras))
    return LiftSplat(GRID, BINS, STRIDE).cells(tensors(*cameras), index, bev_from_ego)


def oracle(camera: Camera, bev: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Column and row (float64, not rounded) of every pixel and bin, and whether the height is in range; from ``Camera``."""
    u = (np.arange(camera.width_px // STRIDE) + 0.5) * STRIDE
    v = (np.arange(camera.height_px // STRIDE) + 0.5) * STRIDE
    pixels = np.stack(np.meshgrid(u, v), axis=-1)
    depth_m = 1.5 + np.arange(30)
    points_ego = camera.ego_from_cam.translation + camera.rays_ego(pixels)[:, :, None] * depth_m[:, None]
    points = points_ego @ bev.T
    return (points[..., :2] + 25.6) / 0.8, points[..., 2]


def test_by_hand() -> None:
    # a level camera 1.6 m up at x = 2, looking along +y: its right is +x
    K = np.array([[32.0, 0, 32], [0, 32, 16], [0, 0, 1]])
    camera = Camera(K, 64, 32, camera_pose((2.0, 0.0, 1.6), np.pi / 2))
    found = cells(camera)
    assert found.shape == (1, 2, 4, 30)
    # block (0, 3): pixel centre (56, 8), ray x/z = 0.75, y/z = -0.25; bin 9 stands for 10.5 m
    # the point: x = 2 + 0.75 * 10.5 = 9.875, y = 10.5, z = 1.6 + 0.25 * 10.5 = 4.2: too high for the grid (z < 3)
    assert found[0, 0, 3, 9] == -1
    # bin 4, 5.5 m: x = 6.125, y = 5.5, z = 2.975: column (6.125 + 25.6) / 0.8 = 39.66, row 31.1 / 0.8 = 38.875
    assert found[0, 0, 3, 4] == 38 * 64 + 39
    # block (1, 0): pixel (8, 24), ray (-0.75, 0.25); bin 25, 26.5 m: x = -17.9, y = 26.5 lies beyond the grid
    assert found[0, 1, 0, 25] == -1
    # bin 20, 21.5 m: x = 2 - 16.125, y = 21.5, z = 1.6 - 5.375 = -3.775: column 14.34, row 58.875
    assert found[0, 1, 0, 20] == 58 * 64 + 14


turn, metres = st.floats(-3.1, 3.1), st.floats(-3, 3)


@settings(max_examples=60, deadline=None)
@given(turn, st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), metres, metres, st.floats(20, 90), st.booleans(), st.integers(0, 99))
def test_agrees_with_camera_geometry(
    yaw: float, pitch: float, roll: float, x: float, y: float, focal_px: float, mirror: bool, seed: int
) -> None:
    K = np.array([[focal_px, 0.3, 45], [0, 1.1 * focal_px, 20], [0, 0, 1]])
    camera = Camera(K, 96, 64, camera_pose((x, y, 1.6), yaw, pitch, roll))
    transform = rotated(fit_width(camera, 96, 48), 0.05)
    camera = (flipped(transform) if mirror else transform).camera(camera)
    bev = BevAugmentation(max_rotation_deg=90).draw(np.random.default_rng(seed))
    place, z_m = oracle(camera, bev)
    found = cells(camera, bev=bev)[0].numpy()
    column, row = np.floor(place).astype(int)[..., 0], np.floor(place).astype(int)[..., 1]
    inside = (column >= 0) & (column < 64) & (row >= 0) & (row < 64) & (z_m >= -5) & (z_m < 3)
    # points within a tenth of a millimetre of a border may fall on either side of it in float32
    from_border = np.minimum(np.abs(place - np.round(place)).min(-1) * 0.8, np.minimum(np.abs(z_m + 5), np.abs(z_m - 3)))
    clear = from_border > 1e-4
    assert clear.mean() > 0.9  # a camera on an axis of the grid may look along a border of cells
    np.testing.assert_array_equal(found[clear], np.where(inside, row * 64 + column, -1)[clear])


def test_autocast_does_not_reach_the_geometry() -> None:
    rig = preset_rig("nuscenes")
    cameras = [fit_width(c, 352, 128).camera(c) for c in rig.values()]
    expected = cells(*cameras)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        assert torch.equal(cells(*cameras), expected)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6))
def test_augmented_boxes_and_features_land_in_the_same_cell(seed: int) -> None:
    """A box on the ray of a pixel, at the depth of a bin: its augmented centre is in the cell of its augmented feature."""
    rng = np.random.default_rng(seed)
    camera = next(iter(ring_rig(1).values()))
    row, column, k = rng.integers(camera.height_px // STRIDE), rng.integers(camera.width_px // STRIDE), rng.integers(20)
    pixel = (np.array([column, row]) + 0.5) * STRIDE
    centre = camera.ego_from_cam.translation + camera.rays_ego(pixel) * (1.5 + k)
    bev = BevAugmentation().draw(rng)
    box = transform_boxes(Boxes3D.create([centre], [(4, 2, 1.5)], [0.3], ["car"]), bev)
    place = (box.centre_m[0, :2] + GRID.half_extent_m) / GRID.cell_m
    on_border = np.abs(place - np.round(place)).min() < 1e-3
    if on_border or not -5 < box.centre_m[0, 2] < 3 or (place < 0).any() or (place > 64).any():
        return
    found = cells(camera, bev=bev)[0, row, column, k]
    assert found == int(place[1]) * 64 + int(place[0])


def test_samples_of_a_batch_have_their_own_grid() -> None:
    first, second = ring_rig(2).values()
    alone = [cells(first), cells(second)]
    together = cells(first, second, sample_index=[0, 1], samples=2)
    assert torch.equal(together[:1], alone[0])
    assert torch.equal(together[1:], torch.where(alone[1] >= 0, alone[1] + 64 * 64, -1))


def test_pooling_sums_where_the_cells_say() -> None:
    lift, cameras = LiftSplat(GRID, BINS, STRIDE), tensors(*ring_rig(3).values())
    torch.manual_seed(0)
    depth, context = torch.rand(3, 30, 4, 6), torch.randn(3, 5, 4, 6)
    index, bev_from_ego = torch.tensor([0, 0, 1]), torch.eye(3).expand(2, 3, 3)
    bev = lift(depth, context, cameras, index, bev_from_ego)
    assert bev.shape == (2, 5, 64, 64)
    cell = lift.cells(cameras, index, bev_from_ego)
    chosen = int(cell[2, 3, 2, 4])
    expected = torch.zeros(5)
    for m, v, u, k in (cell == chosen).nonzero():
        expected += depth[m, k, v, u] * context[m, :, v, u]
    assert chosen >= 64 * 64
    torch.testing.assert_close(bev[1, :, chosen % 4096 // 64, chosen % 64], expected)


def test_slabs_divide_what_one_slab_sums() -> None:
    """Each slab holds the points of its heights, counted by hand; together they are the single slab."""
    edges = (-5.0, 0.3, 1.0, 3.0)
    cameras = tensors(*ring_rig(3).values())
    torch.manual_seed(0)
    depth, context = torch.rand(3, 30, 4, 6), torch.randn(3, 5, 4, 6)
    arguments = (depth, context, cameras, torch.tensor([0, 0, 1]), torch.eye(3).expand(2, 3, 3))
    whole = LiftSplat(GRID, BINS, STRIDE)(*arguments)
    slabs = LiftSplat(replace(GRID, z_edges_m=edges), BINS, STRIDE)(*arguments)
    assert slabs.shape == (2, 15, 64, 64)
    torch.testing.assert_close(slabs.unflatten(1, (3, 5)).sum(1), whole)
    for k in range(3):
        alone = LiftSplat(replace(GRID, z_edges_m=edges[k : k + 2]), BINS, STRIDE)(*arguments)
        assert alone.abs().sum() > 0
        torch.testing.assert_close(slabs[:, 5 * k : 5 * k + 5], alone)


def test_a_known_rig_reuses_its_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    lift = LiftSplat(GRID, BINS, STRIDE, cached_rigs=2)
    computed: list[CameraTensors] = []
    original = lift.cells

    def counted(cameras: CameraTensors, index: torch.Tensor, bev: torch.Tensor) -> torch.Tensor:
        computed.append(cameras)
        return original(cameras, index, bev)

    monkeypatch.setattr(lift, "cells", counted)

    def run(cameras: int, reuse: bool = True, turned: float = 0.0) -> torch.Tensor:
        c = tensors(*ring_rig(cameras).values())
        torch.manual_seed(cameras)
        bev_from_ego = torch.tensor([[[np.cos(turned), -np.sin(turned), 0], [np.sin(turned), np.cos(turned), 0], [0, 0, 1]]])
        inputs = torch.rand(cameras, 30, 4, 6), torch.rand(cameras, 5, 4, 6)
        return lift(*inputs, c, torch.zeros(cameras, dtype=torch.long), bev_from_ego.float(), reuse=reuse)

    fresh = run(2, reuse=False)
    assert torch.equal(run(2), fresh) and torch.equal(run(2), fresh)
    assert len(computed) == 2  # once without the cache, once into it
    assert not torch.equal(run(2, turned=0.4), fresh)  # another augmentation is another key
    run(3)  # a third entry drops the oldest
    assert torch.equal(run(2), fresh)
    assert len(computed) == 5


def test_nonsense_is_refused() -> None:
    with pytest.raises(ValueError, match="depth bins"):
        DepthBins(0.0, 60.0, 0.5)
    with pytest.raises(ValueError, match="depth bins"):
        DepthBins(1.0, 60.0, 0.0)
    with pytest.raises(ValueError, match="whole number of steps"):
        DepthBins(1.0, 60.0, 0.7)
    with pytest.raises(ValueError, match="whole number of cells"):
        BevGrid(half_extent_m=50.0, cell_m=0.8 * 4 / 3)
    with pytest.raises(ValueError, match="BEV grid"):
        BevGrid(cell_m=0.0)
    with pytest.raises(ValueError, match="BEV grid"):
        BevGrid(z_edges_m=(3.0, 3.0))
    with pytest.raises(ValueError, match="two or more rising"):
        BevGrid(z_edges_m=(1.0,))
