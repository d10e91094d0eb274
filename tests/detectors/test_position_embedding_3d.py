"""Points along rays by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from coin3d.detectors.position_embedding_3d import PositionEmbedding3D, RayPoints, sine_code
from coin3d.detectors.space_range import SpaceRange, inverse_sigmoid
from coin3d.geometry.camera_tensors import CameraTensors
from small_world import ring_rig

SPACE = SpaceRange((-10.0, -10.0, -2.0), (10.0, 10.0, 2.0))


def embedding(**changes: float) -> PositionEmbedding3D:
    return PositionEmbedding3D(4, 16, RayPoints(3, 1.0, 13.0), SPACE, **changes)


def cameras() -> CameraTensors:
    rig = ring_rig(4)
    return CameraTensors.from_cameras(list(rig.values()), [rig.ground] * 4)


def test_depths_grow_linearly_from_one_to_the_next() -> None:
    assert RayPoints(3, 1.0, 13.0).depths_m(torch.zeros(())).tolist() == [1.0, 3.0, 7.0]
    with pytest.raises(ValueError, match="first < last"):
        RayPoints(3, 5.0, 2.0)


def test_points_project_to_the_middle_of_their_cells() -> None:
    points = embedding().points_m(cameras(), torch.eye(4).expand(4, 4, 4)).double().numpy()
    assert points.shape == (4, 4, 6, 3, 3)
    for camera, of_camera in zip(ring_rig(4).values(), points, strict=True):
        pixels, depth = camera.project(of_camera.reshape(-1, 3))
        np.testing.assert_allclose(depth.reshape(4, 6, 3), np.broadcast_to([1.0, 3.0, 7.0], (4, 6, 3)), atol=1e-5)
        u, v = np.moveaxis(pixels.reshape(4, 6, 3, 2), -1, 0)
        np.testing.assert_allclose(u, np.broadcast_to(np.arange(8, 96, 16)[None, :, None], u.shape), atol=1e-3)
        np.testing.assert_allclose(v, np.broadcast_to(np.arange(8, 64, 16)[:, None, None], v.shape), atol=1e-3)


def test_frame_of_the_boxes() -> None:
    turn = torch.eye(4)
    turn[:3, :3] = torch.tensor([[0.0, -2.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
    turn[:3, 3] = torch.tensor([1.0, 2.0, 3.0])
    plain = embedding().points_m(cameras(), torch.eye(4).expand(4, 4, 4))
    moved = embedding().points_m(cameras(), turn.expand(4, 4, 4))
    expected = torch.stack([1 - 2 * plain[..., 1], 2 + 2 * plain[..., 0], 3 + 2 * plain[..., 2]], dim=-1)
    torch.testing.assert_close(moved, expected, rtol=1e-5, atol=1e-4)


def test_channels_run_point_by_point() -> None:
    """x, y, z of the first point, then of the second: the order released weights have."""
    embed = PositionEmbedding3D(9, 16, RayPoints(3, 1.0, 13.0), SPACE)
    embed.mlp = torch.nn.Identity()
    out = embed(cameras(), torch.eye(4).expand(4, 4, 4))
    points = embed.points_m(cameras(), torch.eye(4).expand(4, 4, 4))
    assert out.shape == (4, 9, 4, 6)
    expected = inverse_sigmoid(SPACE.normalise(points[2, 1, 3, 1]))
    torch.testing.assert_close(out[2, 3:6, 1, 3], expected)


def test_logits_end_where_the_range_ends() -> None:
    unit = SPACE.normalise(torch.tensor([[0.0, 10.0, -2.0], [5.0, 1e6, -1e6]]))
    torch.testing.assert_close(unit[0], torch.tensor([0.5, 1.0, 0.0]))
    torch.testing.assert_close(SPACE.metres(unit[:1]), torch.tensor([[0.0, 10.0, -2.0]]))
    logits = inverse_sigmoid(unit)
    end = math.log(1e5)
    torch.testing.assert_close(logits, torch.tensor([[0.0, end, -end], [math.log(3), end, -end]]))
    with pytest.raises(ValueError, match="rises along"):
        SpaceRange((0.0, 0.0, 1.0), (1.0, 1.0, 1.0))


def test_sine_code() -> None:
    code = sine_code(torch.tensor([0.25]))[0]
    assert code.shape == (128,)
    torch.testing.assert_close(code[:2], torch.tensor([1.0, 0.0]), rtol=0, atol=1e-6)
    second = 0.5 * math.pi / 10_000 ** (2 / 128)
    torch.testing.assert_close(code[2:4], torch.tensor([math.sin(second), math.cos(second)]))
