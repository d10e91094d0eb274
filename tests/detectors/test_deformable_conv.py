"""Convolution with moved taps: no offset, a whole offset, gradients, and numbers that are none."""

from __future__ import annotations

import torch
from torch.nn import functional as F  # noqa: N812

from coin3d.detectors.deformable_conv import DeformableConv


def test_starts_as_the_plain_convolution() -> None:
    torch.manual_seed(0)
    conv, x = DeformableConv(8, groups=4), torch.randn(2, 8, 5, 7)
    torch.testing.assert_close(conv(x), F.conv2d(x, conv.weight, padding=1, groups=4))


def test_an_offset_reads_elsewhere() -> None:
    conv, x = DeformableConv(1), torch.arange(20.0).reshape(1, 1, 4, 5)
    torch.nn.init.zeros_(conv.weight)
    conv.weight.data[0, 0, 1, 1] = 1.0  # the middle tap alone
    conv.offset.bias.data[2 * 4] = 1.0  # one row down
    conv.offset.bias.data[2 * 4 + 1] = 0.5  # and half a column to the right
    out = conv(x)[0, 0]
    assert out[0].tolist() == [5.5, 6.5, 7.5, 8.5, 4.5]  # beyond the border is 0
    assert out[3].tolist() == [0.0] * 5


def test_gradients() -> None:
    torch.manual_seed(0)
    conv = DeformableConv(2).double()
    torch.nn.init.uniform_(conv.offset.bias, 0.2, 0.8)  # away from whole numbers, where the bilinear slope jumps
    x = torch.randn(1, 2, 3, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(conv, (x,))


def test_what_is_no_number_stays_none_and_stays_inside() -> None:
    conv, x = DeformableConv(4, groups=4), torch.zeros(1, 4, 6, 6)
    torch.nn.init.normal_(conv.offset.weight)
    x[0, 0, 2, 2] = torch.nan
    out = conv(x)
    assert out[0, 0, 2, 2].isnan() and out[0, 0, 5, 5] == 0
