"""Which pinhole camera stands in for a lens, and where its pixels come from."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coin3d.geometry import BrownConrady, Camera, Fisheye, Lens, Pinhole, Rig, camera_pose
from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.geometry.undistort import (
    MAX_VIEW_DEG,
    has_lens,
    pinhole_camera,
    source_pixels,
    undistort_image,
    undistorted_rig,
)

BARREL = BrownConrady(-0.3, 0.1, 0.001, -0.0005)
CUSHION = BrownConrady(0.2, 0.05, 0, 0)
POSE = camera_pose((1.5, 0.2, 1.6), 0.3, 0.1)


def camera(lens: Lens, focal: float = 500.0, width: int = 640, height: int = 400) -> Camera:
    K = np.array([[focal, 0, width / 2 + 4.5], [0, 1.02 * focal, height / 2 - 6.25], [0, 0, 1]])
    return Camera(K, width, height, POSE, lens)


def outermost(bent: Camera) -> np.ndarray:
    """Distances of all origins to the nearest edge of the pixel centres' rectangle, positive inside."""
    at = source_pixels(bent, bent.pixel_grid())
    size = np.array([bent.width_px, bent.height_px])
    return np.minimum(at - 0.5, size - 0.5 - at).min(-1)


def test_a_pinhole_camera_stays_what_it_is() -> None:
    straight = camera(Pinhole())
    assert pinhole_camera(straight) is straight
    image = np.zeros((400, 640, 3), dtype=np.uint8)
    assert undistort_image(image, straight) is image
    rig = Rig({"front": straight})
    assert not has_lens(rig) and undistorted_rig(rig) is rig


def test_a_lens_without_distortion_needs_no_zoom() -> None:
    bent = camera(BrownConrady(0, 0, 0, 0))
    straight = pinhole_camera(bent)
    assert isinstance(straight.lens, Pinhole) and straight.ego_from_cam is bent.ego_from_cam
    np.testing.assert_allclose(straight.K, bent.K, rtol=1e-8)


def test_the_view_by_hand() -> None:
    # 101 x 101 pixels, centre in the middle, f = 100, r' = r (1 + 0.25 r^2): the outermost pixel centres lie at 50 px.
    # Corners are the farthest: r' = 0.5 sqrt(2) there, r by the cubic
    bent = Camera(np.array([[100.0, 0, 50.5], [0, 100, 50.5], [0, 0, 1]]), 101, 101, POSE, BrownConrady(0.25, 0, 0, 0))
    r = np.roots([0.25, 0, 1, -0.5 * np.sqrt(2)])
    r = float(r[np.isreal(r)].real[0])
    # the same corner of the pinhole image: 50 sqrt(2) / f = r
    assert pinhole_camera(bent).focal_px == pytest.approx(50 * np.sqrt(2) / r, rel=1e-6)
    # a barrel is limited by the middles of its sides: r (1 - 0.25 r^2) = 0.5
    barrel = Camera(bent.K, 101, 101, POSE, BrownConrady(-0.25, 0, 0, 0))
    roots = np.roots([-0.25, 0, 1, -0.5])
    r = min(float(x.real) for x in roots if np.isreal(x) and x > 0)
    assert pinhole_camera(barrel).focal_px == pytest.approx(50 / r, rel=1e-6)


@pytest.mark.parametrize(
    "bent",
    [camera(BARREL), camera(CUSHION), camera(BARREL, 900), camera(Fisheye(-0.02, 0.003, 0, 0), 420, 640, 480)],
    ids=["barrel", "cushion", "long", "fisheye"],
)
def test_every_pixel_has_an_origin_and_no_wider_view_would(bent: Camera) -> None:
    distance = outermost(bent)
    assert distance.min() == pytest.approx(0, abs=1e-4)
    straight = pinhole_camera(bent)
    wider = replace(
        straight, K=np.diag([0.999, 0.999, 1]) @ (straight.K - [[0, 0, straight.K[0, 2]], [0, 0, straight.K[1, 2]], [0] * 3])
    )
    rays = np.concatenate(
        [(bent.pixel_grid() - straight.K[:2, 2]) / np.diag(wider.K)[:2], np.ones((*distance.shape, 1))], axis=-1
    )
    at = bent.lens.plane_from_ray(rays) @ bent.K[:2, :2].T + bent.K[:2, 2]
    assert ((at < 0.5) | (at > np.array([bent.width_px, bent.height_px]) - 0.5)).any()


@settings(max_examples=20)
@given(
    st.lists(st.floats(-0.3, 0.3), min_size=2, max_size=2), st.floats(-0.003, 0.003), st.floats(300, 900), st.floats(-0.1, 0.1)
)
def test_no_pixel_is_made_up(radial: list[float], tangential: float, focal: float, fish: float) -> None:
    for lens in (BrownConrady(*radial, tangential, -tangential), Fisheye(fish, 0.01, 0, 0)):
        assert outermost(camera(lens, focal, 160, 100)).min() > -1e-4


def test_a_wide_fisheye_is_cut_to_the_documented_view() -> None:
    bent = camera(Fisheye(0, 0, 0, 0), 640 / np.deg2rad(200))  # sees 200 degrees
    straight = pinhole_camera(bent)
    left, right, top, bottom = straight.rays_cam(
        np.array([[0, straight.K[1, 2]], [640, straight.K[1, 2]], [straight.K[0, 2], 0], [straight.K[0, 2], 400]])
    )
    degrees = np.rad2deg([np.arctan2(np.hypot(x, y), z) for x, y, z in (left, right, top, bottom)])
    assert degrees.max() == pytest.approx(MAX_VIEW_DEG / 2)
    assert outermost(bent).min() > 1
    narrow = pinhole_camera(bent, 90.0)
    assert narrow.focal_px == pytest.approx(straight.focal_px * np.tan(np.deg2rad(60)) / np.tan(np.deg2rad(45)))
    for view in (0.0, 180.0):
        with pytest.raises(ValueError, match="between 0 and 180 degrees"):
            pinhole_camera(bent, view)


def test_points_land_on_the_same_content() -> None:
    """A point seen in the pinhole image comes from where the lens shows it."""
    for lens in (BARREL, CUSHION, Fisheye(0.01, -0.004, 0, 0)):
        bent = camera(lens)
        straight = pinhole_camera(bent)
        points = POSE.apply(np.random.default_rng(0).uniform((-3, -2, 4), (3, 2, 30), (300, 3)))
        pixels, depth = straight.project(points)
        seen = straight.in_image(pixels, depth)
        assert seen.sum() > 50
        np.testing.assert_allclose(source_pixels(bent, pixels[seen]), bent.project(points[seen])[0], atol=1e-8)


def test_the_tables_are_close_to_the_exact_origins() -> None:
    """Images whose grey values are coordinates, 8 levels to a pixel and starting anew every 32 pixels."""
    for lens in (BARREL, CUSHION, Fisheye(0, 0, 0, 0)):
        bent = camera(lens, 420, 401, 307)
        exact = source_pixels(bent, bent.pixel_grid()) - 0.5
        for axis, coordinate in enumerate(np.meshgrid(np.arange(401), np.arange(307))):
            got = undistort_image((8 * coordinate % 256).astype(np.uint8), bent) / 8
            wanted = exact[..., axis] % 32
            away_from_seams = (wanted > 0.5) & (wanted < 30.5)
            assert np.abs(got - wanted)[away_from_seams].max() < 1 / 20 + 1 / 32 + 1 / 16


@pytest.mark.parametrize("lens", [BARREL, CUSHION])
def test_equal_to_opencv(lens: BrownConrady) -> None:
    bent = camera(lens)
    image = np.random.default_rng(0).integers(0, 256, (50, 80, 3), dtype=np.uint8)
    image = np.asarray(cv2.resize(image, (640, 400), interpolation=cv2.INTER_CUBIC))
    shift = np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])  # OpenCV puts the centre of the first pixel at 0
    old, new = bent.K - shift, pinhole_camera(bent).K - shift
    expected = cv2.undistort(image, old, np.array(lens.coefficients), None, new)
    difference = np.abs(undistort_image(image, bent).astype(int) - expected.astype(int))
    inner = difference[2:-2, 2:-2]  # OpenCV fills the outermost pixels with black
    assert inner.max() <= 8 and inner.mean() < 0.2


def test_masks_and_grey_images_are_resampled_too() -> None:
    grey = np.full((400, 640), 200, dtype=np.uint8)
    np.testing.assert_array_equal(undistort_image(grey, camera(BARREL)), grey)


def test_an_image_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match="320 x 200 pixels but the rig says 640 x 400"):
        undistort_image(np.zeros((200, 320, 3), dtype=np.uint8), camera(BARREL))


def test_a_principal_point_outside_the_image_is_refused() -> None:
    K = np.array([[500.0, 0, 900], [0, 500, 200], [0, 0, 1]])
    with pytest.raises(ValueError, match=r"principal point \(900, 200\) lies outside the image of 640 x 400"):
        pinhole_camera(Camera(K, 640, 400, POSE, CUSHION))


def test_an_image_too_large_for_the_tables_is_refused() -> None:
    bent = Camera(np.array([[500.0, 0, 20000], [0, 500, 1], [0, 0, 1]]), 40000, 2, POSE, Fisheye(0, 0, 0, 0))
    with pytest.raises(ValueError, match="too large to be undistorted"):
        undistort_image(np.zeros((2, 40000), dtype=np.uint8), bent)


def test_a_batch_refuses_a_lens() -> None:
    rig = Rig({"front": camera(Pinhole()), "left": camera(BARREL)})
    with pytest.raises(ValueError, match=r"pinhole cameras only, got one with the lens BrownConrady.*undistort"):
        CameraTensors.from_cameras(list(rig.values()), [rig.ground, rig.ground])
    assert len(CameraTensors.from_cameras(list(undistorted_rig(rig).values()), [rig.ground, rig.ground])) == 2


def test_the_field_of_view_through_a_lens() -> None:
    bent = camera(Fisheye(0, 0, 0, 0), 200.0)
    assert bent.fov_horizontal_rad == pytest.approx(2 * 324.5 / 200)  # equidistant: pixels per radian
    assert bent.fov_vertical_rad == pytest.approx(2 * (400 - 193.75) / 204)
