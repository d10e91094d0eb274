"""Prior maps are computed once per rig."""

from __future__ import annotations

import pytest
import torch

from coin3d.geometry import GroundPlane, fit_width, preset_rig
from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.priors import PriorCache, downsample, prior_maps


def cameras(name: str = "nuscenes", ground: GroundPlane | None = None) -> CameraTensors:
    rig = preset_rig(name)
    fitted = [fit_width(c, 96, 32).camera(c) for c in rig.values()]
    return CameraTensors.from_cameras(fitted, [ground or rig.ground] * len(fitted))


def test_a_hit_returns_the_same_tensors_and_computes_nothing() -> None:
    calls = 0

    def count(batch: CameraTensors) -> torch.Tensor:
        nonlocal calls
        calls += 1
        return prior_maps(batch)

    cache = PriorCache(count)
    first, strided = cache.maps(cameras()), cache.maps(cameras(), 16)
    assert cache.maps(cameras()) is first
    assert cache.maps(cameras(), 16) is strided
    assert calls == 1
    torch.testing.assert_close(strided, downsample(prior_maps(cameras()), 16), atol=0, rtol=0)


@pytest.mark.parametrize("changed", ["pose", "K", "ground", "size"])
def test_anything_that_changes_the_maps_is_a_miss(changed: str) -> None:
    cache, batch = PriorCache(), cameras()
    before = cache.maps(batch)
    pose, K, ground, height = batch.ego_from_cam.clone(), batch.K.clone(), batch.ground.clone(), batch.height_px
    if changed == "pose":
        pose[3, 2, 3] += 1e-4
    elif changed == "K":
        K[0, 0, 2] += 0.01
    elif changed == "ground":
        ground[5, 3] -= 1e-3
    else:
        height = 16
    after = cache.maps(CameraTensors(K, pose, ground, height, batch.width_px))
    assert after.shape != before.shape or not torch.equal(after, before)


def test_the_least_recently_used_rig_leaves() -> None:
    cache = PriorCache(capacity=2)
    nuscenes = cache.maps(cameras("nuscenes"))
    cache.maps(cameras("lyft1"))
    assert cache.maps(cameras("nuscenes")) is nuscenes
    cache.maps(cameras("lyft2"))  # pushes lyft1 out
    assert cache.maps(cameras("nuscenes")) is nuscenes
    assert len(cache) == 2
    cache.clear()
    assert cache.maps(cameras("nuscenes")) is not nuscenes


def test_capacity_must_be_positive() -> None:
    with pytest.raises(ValueError, match="at least one"):
        PriorCache(capacity=0)
