"""Augmented pixels stay where the augmented camera projects: a bright dot stands for a point in the world."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coin3d.augmentation import FocalAugmentation, ImageAugmentation, View
from coin3d.geometry import Camera, camera_pose, fit_width

RAW = Camera(np.array([[300.0, 0, 207], [0, 305, 118], [0, 0, 1]]), 400, 260, camera_pose((1.5, 0, 1.6), 0.2, 0.03))
BLUR_PX = 7.0


def dot_view(pixel: np.ndarray) -> View:
    distance = ((RAW.pixel_grid() - pixel) ** 2).sum(-1)
    spot = np.round(255 * np.exp(-distance / (2 * BLUR_PX**2))).astype(np.uint8)
    return View(np.repeat(spot[..., None], 3, axis=-1), RAW, fit_width(RAW, 320, 160))


def centroid(image: np.ndarray) -> np.ndarray:
    weight = image[..., 0].astype(np.float64)
    v, u = np.mgrid[: image.shape[0], : image.shape[1]] + 0.5
    return np.array([(weight * u).sum(), (weight * v).sum()]) / weight.sum()


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.floats(150, 260), st.floats(120, 180))
def test_content_follows_the_camera_through_both(seed: int, u: float, v: float) -> None:
    pixel, rng = np.array([u, v]), np.random.default_rng(seed)
    view = ImageAugmentation()(FocalAugmentation()(dot_view(pixel), rng), rng)
    image, camera = view.network_image(), view.network_camera()
    assert image.shape == (160, 320, 3) and (camera.width_px, camera.height_px) == (320, 160)
    point = RAW.ego_from_cam.translation + 9.0 * RAW.rays_ego(pixel)
    where, depth_m = camera.project(point)
    margin = 3.2 * BLUR_PX * 1.2
    if (where < margin).any() or (where > (320 - margin, 160 - margin)).any():
        return
    np.testing.assert_allclose(centroid(image), where, atol=0.08)
    assert depth_m == pytest.approx(9.0)


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 10**6))
def test_focal_length_is_multiplied_within_its_range(seed: int) -> None:
    view = dot_view(np.array([200.0, 130.0]))
    plain = view.network_camera()
    zoomed = FocalAugmentation(0.7, 1.4)(view, np.random.default_rng(seed)).network_camera()
    ratio = zoomed.focal_px / plain.focal_px
    assert 0.7 - 2e-3 < ratio < 1.4 + 2e-3  # whole pixels: a side of 320 is known to a third of a percent
    # about the principal point, to half a pixel
    np.testing.assert_allclose(zoomed.K[:2, 2], plain.K[:2, 2], atol=0.51)
    assert zoomed.ego_from_cam.allclose(plain.ego_from_cam)


def test_both_ends_of_the_range_are_reached() -> None:
    view = dot_view(np.array([200.0, 130.0]))
    rng = np.random.default_rng(0)
    ratios = [FocalAugmentation()(view, rng).network_camera().focal_px / view.network_camera().focal_px for _ in range(400)]
    assert min(ratios) < 0.72 and max(ratios) > 1.38
    assert np.mean(ratios) == pytest.approx(1.05, abs=0.03)


def test_zooming_out_leaves_a_black_border() -> None:
    white = View(np.full((260, 400, 3), 255, dtype=np.uint8), RAW, fit_width(RAW, 320, 160))
    out = FocalAugmentation(0.7, 0.7)(white, np.random.default_rng(0)).network_image()
    assert (out[:, :30] == 0).all() and (out[100, 100:200] == 255).all()


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (1.2, 1.1), (-1.0, 2.0)])
def test_impossible_focal_ranges_are_refused(low: float, high: float) -> None:
    with pytest.raises(ValueError, match="focal ratios"):
        FocalAugmentation(low, high)


def test_mirror_and_turn_within_their_range() -> None:
    view, rng = dot_view(np.array([200.0, 130.0])), np.random.default_rng(1)
    plain = view.network_camera().K[:2, :2]
    mirrored, angles = 0, []
    for _ in range(300):
        turned = ImageAugmentation(0.5, 5.4)(view, rng).network_camera().K[:2, :2] @ np.linalg.inv(plain)
        flip = np.linalg.det(turned) < 0
        mirrored += flip
        rotation = turned @ np.diag([-1.0, 1.0]) if flip else turned
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(2), atol=1e-9)
        angles.append(np.rad2deg(np.arctan2(rotation[1, 0], rotation[0, 0])))
    assert 120 < mirrored < 180
    assert max(angles) <= 5.4 and min(angles) >= -5.4 and max(angles) > 5 and min(angles) < -5


def test_switched_off_nothing_changes() -> None:
    view, rng = dot_view(np.array([200.0, 130.0])), np.random.default_rng(1)
    same = ImageAugmentation(0.0, 0.0)(view, rng)
    np.testing.assert_array_equal(same.network_image(), view.network_image())
    np.testing.assert_array_equal(same.network_camera().K, view.network_camera().K)
    only_mirror = ImageAugmentation(1.0, 0.0)(view, rng)
    np.testing.assert_array_equal(only_mirror.network_image(), view.network_image()[:, ::-1])


def test_same_generator_same_view() -> None:
    view = dot_view(np.array([200.0, 130.0]))
    a, b = (ImageAugmentation()(FocalAugmentation()(view, g), g) for g in (np.random.default_rng(5), np.random.default_rng(5)))
    np.testing.assert_array_equal(a.network_camera().K, b.network_camera().K)
