"""Prior maps of the released code, on four synthetic rigs (one with image rotation, zoom and flip)."""

from __future__ import annotations

from typing import Literal

import pytest
import torch
from parity_files import fixture

from coin3d.priors import ReleasedConventions, downsample, released_maps
from coin3d.priors.channels import DIRECTION, MOMENT, PLUECKER

# the two ground maps amplify the released code's float32 rounding near the horizon
TOLERANCES = torch.tensor([2e-6, 1e-4, 1e-4, *[2e-6] * 6])


@pytest.fixture(params=["nus6_384x704", "nus6_aug_384x704", "lyft6_384x704", "waymo5_320x704"])
def stored(request: pytest.FixtureRequest) -> dict[str, torch.Tensor]:
    return {k: torch.from_numpy(v) for k, v in fixture(f"coin3d_prior_{request.param}.npz").items() if v.ndim}


def maps(stored: dict[str, torch.Tensor], moment: Literal["ego_in_cam", "cam_in_ego"], turned: bool = False) -> torch.Tensor:
    height, width = stored["size"].tolist()
    inputs = (stored[k] for k in ("K", "sensor2ego", "post_rot", "post_tran"))
    return released_maps(*inputs, (height, width), ReleasedConventions(moment=moment), turned)


def assert_equal(ours: torch.Tensor, theirs: torch.Tensor, channels: slice) -> None:
    assert ours[:, channels].shape == theirs.shape
    error = (ours[:, channels] - theirs).abs().amax(dim=(0, 2, 3))
    assert (error <= TOLERANCES[channels]).all(), f"largest error per channel: {error.tolist()}"


def test_full_resolution(stored: dict[str, torch.Tensor]) -> None:
    assert_equal(maps(stored, "ego_in_cam")[..., 3::8, 5::8], stored["full_sub"], slice(None))
    assert_equal(maps(stored, "cam_in_ego")[..., 3::8, 5::8], stored["moment_cie_full_sub"], MOMENT)


@pytest.mark.parametrize("stride", [16, 32])
def test_downsampled(stored: dict[str, torch.Tensor], stride: int) -> None:
    assert_equal(downsample(maps(stored, "ego_in_cam"), stride), stored[f"ds{stride}"], slice(None))
    assert_equal(downsample(maps(stored, "cam_in_ego"), stride), stored[f"moment_cie_ds{stride}"], MOMENT)


def test_ego_frame_turned_front_to_back(stored: dict[str, torch.Tensor]) -> None:
    mixed_frames = downsample(maps(stored, "ego_in_cam", turned=True), 16)
    assert_equal(mixed_frames, torch.cat([stored["fbflip_ray_ds16"], stored["fbflip_moment_ds16"]], dim=1), PLUECKER)
    assert_equal(mixed_frames, stored["fbflip_ray_ds16"], DIRECTION)
    assert_equal(downsample(maps(stored, "cam_in_ego", turned=True), 16), stored["fbflip_moment_cie_ds16"], MOMENT)
    # turning the frame leaves focal and ground maps alone
    assert torch.equal(mixed_frames[:, :3], downsample(maps(stored, "ego_in_cam"), 16)[:, :3])
