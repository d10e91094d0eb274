"""Where the outputs of the released implementations lie, and the generator of their weights."""

from __future__ import annotations

import ast
import importlib.util
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import torch
from torch import Tensor

FOLDER = Path(os.environ.get("COIN3D_PARITY", Path(__file__).parents[2] / ".." / "shared" / "parity"))


def fixture(name: str) -> dict[str, np.ndarray]:
    """The arrays of one fixture file; the test is skipped if it is absent."""
    path = FOLDER / name
    if not path.is_file():
        pytest.skip(f"{path} is absent; set COIN3D_PARITY to the folder of parity fixtures")
    with np.load(path) as arrays:
        return {key: arrays[key] for key in arrays.files}


def filler() -> ModuleType:
    """The module that generates weights and inputs from names."""
    path = FOLDER / "filler.py"
    if not path.is_file():
        pytest.skip(f"{path} is absent; set COIN3D_PARITY to the folder of parity fixtures")
    spec = importlib.util.spec_from_file_location("parity_filler", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def released_shapes(name: str) -> dict[str, tuple[int, ...]]:
    """Every key of a released file, with its shape; the test is skipped if the list is absent."""
    path = FOLDER / name
    if not path.is_file():
        pytest.skip(f"{path} is absent; set COIN3D_PARITY to the folder of parity fixtures")
    lines = (line.split(" ", 1) for line in path.read_text().splitlines() if line.strip())
    return {key: ast.literal_eval(shape) for key, shape in lines}


def released_weights(name: str, canon: Callable[[str], str] = str, gain: Iterable[tuple[str, float]] = ()) -> dict[str, Tensor]:
    """What a released file would hold, were it made of the generator's numbers.

    Args:
        name: of the list of keys.
        canon: key -> the key its numbers are generated from, where copies are equal.
        gain: part of a key -> factor of its numbers.
    """
    generated, weights = filler(), {}
    for key, shape in released_shapes(name).items():
        value = generated.value(canon(key), shape)
        if value is None:
            weights[key] = torch.zeros(shape, dtype=torch.long if key.endswith("num_batches_tracked") else torch.float32)
            continue
        for part, factor in gain:
            if part in key:
                value = value * np.float32(factor)
        weights[key] = torch.from_numpy(np.ascontiguousarray(value, dtype=np.float32))
    return weights
