"""Box coding of released query detectors, turned to ours where it is made: in the rows of the last box layer."""

from __future__ import annotations

from typing import Literal

import torch
from jaxtyping import Shaped
from torch import Tensor

SizeOrder = Literal["width-length", "length-width"]
"""How a released coding stores the logarithms of width and length."""


def our_box_rows(rows: Shaped[Tensor, "10 *rest"], sizes: SizeOrder) -> Shaped[Tensor, "10 *rest"]:
    """Rows of a released box layer, or released codes, in our coding (``query_boxes``): length before width, yaw from +x.

    The released yaw is -yaw - pi / 2, so that sin(yaw) = -cos(released) and cos(yaw) = -sin(released) (spec detectors 2).

    Args:
        rows: x, y, two log sizes, z, log height, sine and cosine of the released yaw, velocity x and y.
        sizes: which of the two log sizes comes first.
    """
    length, width = (rows[3], rows[2]) if sizes == "width-length" else (rows[2], rows[3])
    return torch.stack([*rows[:2], length, width, *rows[4:6], -rows[7], -rows[6], *rows[8:]])
