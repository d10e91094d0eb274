"""Images as Megvii's released code feeds them, for its weights only (spec detectors 1, Oddities)."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

from coin3d.detectors.batch import IMAGE_MEAN, IMAGE_STD


def swapped(images: Float[Tensor, "m 3 h w"]) -> Float[Tensor, "m 3 h w"]:
    """Blue first, but with the mean of red taken from blue, and so on.

    The offset that makes cannot be worked into the first convolution: at the border its padding is zero after the offset.
    """
    mean, std = (images.new_tensor(values)[:, None, None] for values in (IMAGE_MEAN, IMAGE_STD))
    return ((images * std + mean).flip(1) - mean) / std
