"""Which of the cameras that released weights know a camera stands in for: the one that looks most nearly the same way.

Released query detectors have an embedding for each of nuScenes' cameras and find it by the place of an image in their list.
Here a rig may have any number of cameras in any order, so that it is found by where a camera looks.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float, Int
from torch import Tensor

NUSCENES_HEADINGS_DEG = (0.0, -55.0, 55.0, 180.0, 110.0, -110.0)
"""Where nuScenes' cameras look, counter-clockwise from forward, in the released order: front, front right, front left, back,
back left, back right (spec detectors, Common traps)."""


def camera_seats(ego_from_cam: Float[Tensor, "m 4 4"], headings_deg: tuple[float, ...]) -> Int[Tensor, "m"]:
    """For each camera the index of the heading nearest to its own, which is that of its optical axis on the ground."""
    heading = torch.atan2(ego_from_cam[:, 1, 2], ego_from_cam[:, 0, 2])
    seats = torch.deg2rad(torch.tensor(headings_deg, dtype=heading.dtype, device=heading.device))
    apart = torch.remainder(heading[:, None] - seats + math.pi, 2 * math.pi) - math.pi
    return apart.abs().argmin(dim=1)
