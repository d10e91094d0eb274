"""Numbers too small to matter, which would take a CPU ten times as long as others."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def denormals_flushed() -> Iterator[None]:
    """Count denormal numbers (below 1e-38 in float32) as zero.

    Once attention is sharp, most of its weights and their gradients fade into that range, and a step of training takes twice
    as long as before. The mode belongs to a thread, and threads inherit it: enter before the first operation that torch shares
    among its threads. Afterwards the calling thread computes with denormals again; those started meanwhile do not.
    """
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(False)
