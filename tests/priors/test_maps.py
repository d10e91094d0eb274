"""The prior maps against hand-computed pixels and against the float64 oracle on random rigs."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from coin3d.geometry import Camera, GroundPlane, camera_pose, fit_width, preset_rig
from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.geometry.image_transform import ImageTransform, flipped, rotated, zoomed
from coin3d.geometry.pose import Pose
from coin3d.priors import PriorOptions, downsample, prior_maps
from coin3d.priors.channels import DIRECTION, GROUND_DEPTH, GROUND_GRADIENT, INVERSE_FOCAL, MOMENT
from coin3d.priors.reference import ground_depth_m, reference_maps

CAP_M = 60.0


def as_stored(cameras: CameraTensors, index: int) -> tuple[Camera, GroundPlane]:
    """The camera and ground that the float32 tensors really hold: rounding of the calibration is not the maps' error."""
    ground = cameras.ground[index].double().numpy()
    pose = cameras.ego_from_cam[index].double().numpy()
    camera = Camera(cameras.K[index].double().numpy(), cameras.width_px, cameras.height_px, Pose.from_matrix(pose))
    # a pose re-orthonormalises its rotation; the oracle must see the rounded one
    object.__setattr__(camera.ego_from_cam, "rotation", pose[:3, :3])
    plane = GroundPlane(ground[:3], ground[3])
    object.__setattr__(plane, "normal", ground[:3])
    object.__setattr__(plane, "offset_m", float(ground[3]))
    return camera, plane


def tensors(*cameras: Camera, ground: GroundPlane | None = None) -> CameraTensors:
    return CameraTensors.from_cameras(cameras, [ground or GroundPlane()] * len(cameras))


angle = st.floats(-1, 1)


@st.composite
def augmented_cameras(draw: st.DrawFn) -> tuple[list[Camera], GroundPlane]:
    """One to three cameras of one network size, after zoom, crop, rotation and flip, above a tilted ground."""
    width, height = draw(st.sampled_from([(96, 40), (64, 64), (176, 96)]))
    cameras = []
    for _ in range(draw(st.integers(1, 3))):
        fx = draw(st.floats(0.4, 2.0)) * 400
        K = np.array([[fx, 0, 200 + 30 * draw(angle)], [0, fx * draw(st.floats(0.8, 1.25)), 120 + 20 * draw(angle)], [0, 0, 1]])
        position = (3 * draw(angle), 1.5 * draw(angle), draw(st.floats(1.0, 3.5)))
        pose = camera_pose(position, np.pi * draw(angle), 0.3 * draw(angle), 0.2 * draw(angle))
        raw = Camera(K, 400, 240, pose)
        transform: ImageTransform = fit_width(raw, width, height)
        transform = zoomed(transform, raw, draw(st.floats(0.7, 1.4)))
        if draw(st.booleans()):
            transform = rotated(transform, np.deg2rad(6) * draw(angle))
        if draw(st.booleans()):
            transform = flipped(transform)
        cameras.append(transform.camera(raw))
    normal = np.array([0.08 * draw(angle), 0.08 * draw(angle), 1.0])
    return cameras, GroundPlane(normal, 0.3 * draw(angle))


@settings(max_examples=60, deadline=None)
@given(augmented_cameras())
def test_maps_agree_with_the_float64_oracle(case: tuple[list[Camera], GroundPlane]) -> None:
    cameras, ground = case
    batch = tensors(*cameras, ground=ground)
    maps = prior_maps(batch).double().numpy()
    for index in range(len(cameras)):
        camera, plane = as_stored(batch, index)
        expected = reference_maps(camera, plane)
        # a pixel that meets the ground within a hair of the cap may fall on either side of it
        here, above = (ground_depth_m(camera, plane, camera.pixel_grid() - (0, dv), cap_m=1e9) for dv in (0, 1))
        at_cap = (np.abs(here - CAP_M) < 1e-6) | (np.abs(above - CAP_M) < 1e-6)
        assert np.abs(maps[index] - expected)[:, ~at_cap].max() < 1e-5


@settings(max_examples=20, deadline=None)
@given(augmented_cameras())
def test_a_ground_pixel_lifted_by_its_depth_lies_on_the_ground(case: tuple[list[Camera], GroundPlane]) -> None:
    cameras, ground = case
    maps = prior_maps(tensors(*cameras, ground=ground)).double().numpy()
    for camera, prior in zip(cameras, maps, strict=True):
        points = camera.ego_from_cam.translation + np.moveaxis(prior[DIRECTION] * prior[GROUND_DEPTH] * 25, 0, -1)
        on_ground = prior[GROUND_DEPTH] > 0
        assert np.abs(ground.height_m(points))[on_ground].max(initial=0) < 1e-3


def test_hand_computed_pixel() -> None:
    # f = 100 px, 1.5 m high, looking forward; the pixel row 30.5 is 10.5 px below the principal point
    camera = Camera(np.array([[100.0, 0, 50.5], [0, 100, 20], [0, 0, 1]]), 101, 40, camera_pose((1.7, 0.2, 1.5)))
    prior = prior_maps(tensors(camera), PriorOptions(reference_focal_px=250.0))[0, :, 30, 50]
    depth, depth_above = 1.5 * 100 / 10.5, 1.5 * 100 / 9.5
    expected = [6.25, depth / 25, np.log(1 / (depth_above - depth) + 1) / 2]
    direction = np.array([1.0, 0.0, -0.105])
    np.testing.assert_allclose(prior, [*expected, *direction, *np.cross([1.7, 0.2, 1.5], direction)], atol=1e-6)


def test_sky_and_ground_beyond_the_cap_are_zero() -> None:
    camera = Camera(np.array([[100.0, 0, 50], [0, 100, 20], [0, 0, 1]]), 100, 40, camera_pose((0, 0, 1.5)))
    maps = prior_maps(tensors(camera))[0]
    # rows 20, 21 are 0.5 and 1.5 px below the horizon: 300 m and 100 m away; row 22 is 60 m away exactly
    assert not maps[GROUND_DEPTH, :22].any()
    np.testing.assert_allclose(maps[GROUND_DEPTH, 22] * 25, 60.0, rtol=1e-6)
    assert not maps[GROUND_GRADIENT, :23].any()
    assert (maps[GROUND_GRADIENT, 23:] > 0).all()


def test_reference_focal_follows_the_input_width() -> None:
    at_704, at_352 = (fit_width(c, w, 128).camera(c) for c in [preset_rig("nuscenes")["CAM_FRONT"]] for w in (704, 352))
    full, half = (prior_maps(tensors(c))[0, INVERSE_FOCAL, 0, 0].item() for c in (at_704, at_352))
    assert full == pytest.approx((500 / 550) ** 2, rel=1e-6)
    assert half == pytest.approx(full, rel=1e-6)
    kept = prior_maps(tensors(at_352), PriorOptions().resolved(704))[0, INVERSE_FOCAL, 0, 0].item()
    assert kept == pytest.approx(4 * full, rel=1e-6)


def test_maps_of_a_crop_are_the_crop_of_the_maps() -> None:
    camera = fit_width(preset_rig("lyft1")["CAM_BACK_LEFT"], 352, 200).camera(preset_rig("lyft1")["CAM_BACK_LEFT"])
    shift = np.array([[1.0, 0, -40], [0, 1, -72], [0, 0, 1]])
    crop = camera.transformed(shift, 240, 128)
    options = PriorOptions(reference_focal_px=250.0)
    whole, part = prior_maps(tensors(camera), options)[0], prior_maps(tensors(crop), options)[0]
    torch.testing.assert_close(part, whole[:, 72:, 40:280], atol=2e-5, rtol=0)


def test_maps_of_a_mirrored_image_are_the_mirrored_maps() -> None:
    raw = preset_rig("waymo")["FRONT_LEFT"]
    plain = fit_width(raw, 352, 192)
    maps = prior_maps(tensors(plain.camera(raw), flipped(plain).camera(raw)))
    torch.testing.assert_close(maps[1], maps[0].flip(-1), atol=2e-5, rtol=0)


def test_priors_do_not_see_a_camera_below_the_ground() -> None:
    camera = Camera(np.array([[100.0, 0, 50], [0, 100, 20], [0, 0, 1]]), 100, 40, camera_pose((0, 0, -0.5)))
    maps = prior_maps(tensors(camera))
    assert maps.isfinite().all() and not maps[:, GROUND_DEPTH : GROUND_GRADIENT + 1].any()


def test_direction_and_moment_are_orthogonal() -> None:
    maps = prior_maps(tensors(*(fit_width(c, 176, 96).camera(c) for c in preset_rig("nuscenes").values())))
    assert (maps[:, DIRECTION] * maps[:, MOMENT]).sum(1).abs().max() < 1e-5


def test_downsample_averages_ground_over_valid_pixels() -> None:
    maps = torch.zeros(1, 9, 4, 4)
    maps[0, INVERSE_FOCAL] = 0.5
    maps[0, GROUND_DEPTH, 2:, :] = torch.tensor([[1.0, 0, 0, 0], [3.0, 0, 0, 0]])
    maps[0, DIRECTION, :2, :2] = 4.0
    small = downsample(maps, 2)
    assert small.shape == (1, 9, 2, 2)
    assert small[0, GROUND_DEPTH].tolist() == [[0, 0], [2, 0]]
    assert (small[0, INVERSE_FOCAL] == 0.5).all()
    assert small[0, 3].tolist() == [[4, 0], [0, 0]]


def test_downsample_has_the_size_of_a_strided_convolution() -> None:
    maps = torch.ones(1, 9, 25, 50)
    assert downsample(maps, 16).shape[-2:] == (2, 4)
    assert torch.equal(downsample(maps, 16), torch.ones(1, 9, 2, 4))


def test_options_reject_nonsense() -> None:
    with pytest.raises(ValueError, match="reference focal length is positive"):
        PriorOptions(reference_focal_px=0.0)
    with pytest.raises(ValueError, match="cap of the ground depth is positive"):
        PriorOptions(ground_cap_m=-1.0)
