"""Training computes without denormals, and only training does."""

from __future__ import annotations

import subprocess
import sys

import pytest
import torch

from coin3d.training.denormals import denormals_flushed

DENORMAL = 1e-40


def halved() -> float:
    return float((torch.full((1,), DENORMAL) / 2)[0])


def test_denormals_are_zero_inside_and_numbers_outside() -> None:
    before = halved()
    with denormals_flushed():
        assert halved() == 0
    assert halved() == before == pytest.approx(DENORMAL / 2, rel=1e-3)


def test_threads_that_torch_starts_inside_flush_as_well() -> None:
    program = (
        "import torch\n"
        "from coin3d.training.denormals import denormals_flushed\n"
        "torch.set_num_threads(2)\n"
        "with denormals_flushed():\n"
        "    numbers = torch.full((2_000_000,), 1e-40)\n"
        "    print(int((numbers / 2).count_nonzero()))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "0"
