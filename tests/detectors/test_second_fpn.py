"""Neck of folded and spread levels, and the encoder of bird's-eye views that ends in one."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from coin3d.detectors.bev_resnet import BevResNet
from coin3d.detectors.second_fpn import SecondFPN


def test_levels_meet_by_hand() -> None:
    neck = SecondFPN([1, 1, 1], [4, 8, 16], 8, 3).eval()
    for branch in neck.branches:
        conv, norm, _ = branch
        nn.init.zeros_(conv.weight)
        conv.weight.data += torch.arange(1.0, 1 + conv.weight.numel()).reshape(conv.weight.shape)
        norm.eps = 0.0
    fine = torch.tensor([[[[1.0, 0, 0, 0], [0, 1, 0, 2], [0, 0, 0, 0], [0, 0, 0, 0]]]])
    middle, coarse = torch.tensor([[[[3.0, -4.0], [0.0, 1.0]]]]), torch.tensor([[[[5.0]]]])
    with torch.no_grad():
        folded, same, spread = neck([fine, middle, coarse])[0]
    assert folded.tolist() == [[5.0, 8.0], [0.0, 0.0]]  # kernel 1 2 / 3 4 on 1 0 / 0 1 and on 0 0 / 0 2
    assert same.tolist() == [[3.0, 0.0], [0.0, 1.0]]
    assert spread.tolist() == [[5.0, 10.0], [15.0, 20.0]]


def test_levels_that_do_not_meet_are_refused() -> None:
    with pytest.raises(ValueError, match="16 channels of a neck cannot be shared by 3"):
        SecondFPN([4, 4, 4], [4, 8, 16], 8, 16)
    with pytest.raises(ValueError, match=r"strides \(4, 6\)"):
        SecondFPN([4, 4], [4, 6], 4, 16)


def test_encoder_keeps_the_grid() -> None:
    encoder = BevResNet(6, (8, 12, 16), 16).eval()
    sizes = []
    for stage in encoder.stages:
        stage.register_forward_hook(lambda _module, _inputs, out: sizes.append(tuple(out.shape[1:])))
    with torch.no_grad():
        assert encoder(torch.zeros(2, 6, 32, 32)).shape == (2, 16, 32, 32)
    assert sizes == [(8, 16, 16), (12, 8, 8), (16, 4, 4)]
