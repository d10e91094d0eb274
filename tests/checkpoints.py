"""Checkpoints of a detector of a few cells, untrained: enough for everything around the network."""

from __future__ import annotations

from pathlib import Path

import torch

from coin3d.methods import METHODS
from coin3d.training.checkpoint import build_detector, describe, save_checkpoint
from small_world import CONFIG


def write_checkpoint(path: Path, method: str = "coin3d", classes: tuple[str, ...] = ("car",)) -> Path:
    options = METHODS[method][0]()
    torch.manual_seed(0)
    model = build_detector("bevdepth", CONFIG, classes, method, options)
    notes = "trained on town_nuscenes for 3 steps"
    save_checkpoint(path, model.state_dict(), describe("bevdepth", CONFIG, classes, method, options, notes))
    return path
