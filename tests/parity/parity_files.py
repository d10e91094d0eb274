"""Where the outputs of the released implementations lie, and the generator of their weights."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

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
