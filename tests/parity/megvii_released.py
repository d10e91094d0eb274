"""Names, shapes and generated weights of Megvii's released BEVDepth."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import torch
from parity_files import FOLDER, filler
from torch import Tensor

KEY_LIST = FOLDER / "bevdepth_2key_da_keys.txt"
FIXTURE_SIZE_PX = (192, 64)
VARIANTS = {"1key": (1, False), "2key": (2, False), "2key_da": (2, True)}
"""Name of the fixture -> frames, depth aggregation."""


def released_shapes(frames: int = 2, depth_aggregation: bool = True) -> dict[str, tuple[int, ...]]:
    """Name -> shape of every weight of a variant; the list is of two frames with depth aggregation."""
    if not KEY_LIST.is_file():
        pytest.skip(f"{KEY_LIST} is absent; set COIN3D_PARITY to the folder of parity fixtures")
    pairs = (line.split(maxsplit=1) for line in KEY_LIST.read_text().splitlines() if line.strip())
    shapes = {name: tuple(int(n) for n in shape.strip("() \n").split(",") if n.strip()) for name, shape in pairs}
    shapes["model.head.trunk.conv1.weight"] = (160, 80 * frames, 7, 7)
    shapes["model.head.neck.deblocks.0.0.weight"] = (80 * frames, 64, 1, 1)
    return {name: shape for name, shape in shapes.items() if depth_aggregation or "depth_aggregation_net" not in name}


_filler = cache(filler)


@cache
def _generated(name: str, shape: tuple[int, ...]) -> Tensor:
    value = None if "voxel_" in name or "frustum" in name else _filler().value(name.removeprefix("model."), shape)
    return torch.zeros(shape, dtype=torch.long) if value is None else torch.from_numpy(np.ascontiguousarray(value)).float()


def released_weights(frames: int, depth_aggregation: bool) -> dict[str, Tensor]:
    """A variant's weights, generated from their names."""
    return {name: _generated(name, shape) for name, shape in released_shapes(frames, depth_aggregation).items()}
