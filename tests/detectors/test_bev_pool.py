"""Lift-splat pooling: native code, its PyTorch reference and a plain loop in float64."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from coin3d import native
from coin3d.detectors.bev_pool import bev_pool, bev_pool_reference


@pytest.fixture(autouse=True)
def restore_threads() -> Iterator[None]:
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


def inputs(seed: int, pixels: int, bins: int, channels: int, cells: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    rng = np.random.default_rng(seed)
    depth = torch.from_numpy(rng.random((pixels, bins), dtype=np.float32))
    context = torch.from_numpy(rng.standard_normal((pixels, channels)).astype(np.float32))
    cell = torch.from_numpy(rng.integers(-1, cells, (pixels, bins)).astype(np.int32))
    return depth, context, cell


def by_loops(
    depth: torch.Tensor, context: torch.Tensor, cell: torch.Tensor, grad_bev: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pooled features and the gradients of depth and context, from the definition."""
    d, c, rows = depth.double().numpy(), context.double().numpy(), cell.numpy()
    bev, grad_depth, grad_context = np.zeros(grad_bev.shape), np.zeros_like(d), np.zeros_like(c)
    for p in range(d.shape[0]):
        for k in range(d.shape[1]):
            if rows[p, k] >= 0:
                bev[rows[p, k]] += d[p, k] * c[p]
                grad_depth[p, k] = grad_bev[rows[p, k]] @ c[p]
                grad_context[p] += d[p, k] * grad_bev[rows[p, k]]
    return bev, grad_depth, grad_context


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.integers(0, 30), st.integers(1, 9), st.integers(1, 37), st.integers(1, 20))
def test_native_and_reference_equal_the_definition(seed: int, pixels: int, bins: int, channels: int, cells: int) -> None:
    depth, context, cell = inputs(seed, pixels, bins, channels, cells)
    grad = np.random.default_rng(seed + 1).standard_normal((cells, channels)).astype(np.float32)
    expected = by_loops(depth, context, cell, grad)
    for pool in (bev_pool, bev_pool_reference):
        d, c = depth.clone().requires_grad_(), context.clone().requires_grad_()
        bev = pool(d, c, cell, cells)
        assert bev.shape == (cells, channels)
        bev.backward(torch.from_numpy(grad))
        for ours, theirs in zip((bev, d.grad, c.grad), expected, strict=True):
            assert ours is not None
            np.testing.assert_allclose(ours.detach().numpy(), theirs, rtol=2e-5, atol=2e-5)


def test_by_hand() -> None:
    depth = torch.tensor([[0.25, 0.75], [1.0, 0.5]])
    context = torch.tensor([[4.0, 8.0], [1.0, -1.0]])
    cell = torch.tensor([[2, 0], [2, -1]], dtype=torch.int32)
    expected = torch.tensor([[3.0, 6.0], [0.0, 0.0], [2.0, 1.0]])
    assert torch.equal(bev_pool(depth, context, cell, 3), expected)


@pytest.mark.parametrize("channels", [1, 5, 16, 80, 83])
def test_any_number_of_threads_gives_the_same_bits(channels: int) -> None:
    depth, context, cell = inputs(3, 500, 20, channels, 90)
    results = []
    for threads in (1, 2, 3):
        torch.set_num_threads(threads)
        d, c = depth.clone().requires_grad_(), context.clone().requires_grad_()
        bev = bev_pool(d, c, cell, 90)
        (bev**2).sum().backward()
        assert d.grad is not None and c.grad is not None
        results.append((bev.detach(), d.grad, c.grad))
    for other in results[1:]:
        assert all(torch.equal(a, b) for a, b in zip(results[0], other, strict=True))


def test_outside_the_grid_nothing_lands_and_no_gradient_flows() -> None:
    depth, context, _ = inputs(0, 7, 4, 5, 6)
    depth.requires_grad_()
    context.requires_grad_()
    bev = bev_pool(depth, context, torch.full((7, 4), -1, dtype=torch.int32), 6)
    assert not bev.any()
    bev.sum().backward()
    assert depth.grad is not None and not depth.grad.any()
    assert context.grad is not None and not context.grad.any()


@pytest.mark.parametrize("pool", [bev_pool, bev_pool_reference])
def test_no_pixels_give_an_empty_grid(pool: type) -> None:
    depth, context, cell = inputs(0, 0, 4, 5, 6)
    assert torch.equal(pool(depth, context, cell, 6), torch.zeros(6, 5))


def test_strided_and_half_precision_inputs() -> None:
    depth, context, cell = inputs(1, 12, 6, 8, 10)
    strided = bev_pool(depth.T.contiguous().T, context.T.contiguous().T, cell.T.contiguous().T, 10)
    assert torch.equal(strided, bev_pool(depth, context, cell, 10))
    half = context.bfloat16().requires_grad_()
    pooled = bev_pool(depth, half, cell, 10)
    assert pooled.dtype == torch.float32
    pooled.sum().backward()
    assert half.grad is not None and half.grad.dtype == torch.bfloat16


def test_cell_beyond_the_grid_is_refused() -> None:
    depth, context, cell = inputs(0, 3, 2, 4, 6)
    cell[1, 1] = 6
    with pytest.raises(ValueError, match="outside the grid"):
        bev_pool(depth, context, cell, 6)
    with pytest.raises(ValueError, match="outside the grid"):
        grads = np.zeros((3, 2), np.float32), np.zeros((3, 4), np.float32)
        native.bev_pool_backward(np.zeros((6, 4), np.float32), depth.numpy(), context.numpy(), cell.numpy(), *grads)


def test_shapes_that_contradict_each_other_are_refused() -> None:
    depth, context, cell = inputs(0, 3, 2, 4, 6)
    bev = np.zeros((6, 4), np.float32)
    with pytest.raises(ValueError, match="numbers of pixels"):
        native.bev_pool_forward(depth.numpy(), context[:2].numpy(), cell.numpy(), bev)
    with pytest.raises(ValueError, match="differ in shape"):
        native.bev_pool_forward(depth.numpy(), context.numpy(), cell[:, :1].contiguous().numpy(), bev)
    with pytest.raises(ValueError, match="numbers of channels"):
        native.bev_pool_forward(depth.numpy(), context.numpy(), cell.numpy(), np.zeros((6, 5), np.float32))
