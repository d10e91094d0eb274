"""Image transforms: the pixels go where K says. A bright dot stands for a point in the world."""

from __future__ import annotations

import numpy as np
import pytest

from coin3d.geometry import Camera, ImageTransform, camera_pose, fit_width, preset_rig
from coin3d.geometry.image_transform import flipped, rotated, zoomed

RAW = Camera(np.array([[500.0, 0, 330], [0, 510, 190], [0, 0, 1]]), 640, 400, camera_pose((1.5, 0, 1.6), 0.2, 0.03))
DOT_PX = 9.0
"""Blur of the dots: wide enough to survive resizing by any factor used here."""


def dot_image(camera: Camera, centre: np.ndarray) -> np.ndarray:
    """A Gaussian spot around a pixel position."""
    distance = ((camera.pixel_grid() - centre) ** 2).sum(-1)
    spot = 255 * np.exp(-distance / (2 * DOT_PX**2))
    return np.repeat(np.round(spot)[..., None], 3, axis=-1).astype(np.uint8)


def centroid(image: np.ndarray) -> np.ndarray:
    weight = image[..., 0].astype(np.float64)
    v, u = np.mgrid[: image.shape[0], : image.shape[1]] + 0.5
    return np.array([(weight * u).sum(), (weight * v).sum()]) / weight.sum()


def augmented(camera: Camera) -> dict[str, ImageTransform]:
    plain = fit_width(camera, 352, 160)
    return {
        "same size": fit_width(camera, camera.width_px, camera.height_px),
        "resize and crop": plain,
        "pad": fit_width(camera, 352, 300),
        "enlarge": fit_width(camera, 800, 450),
        "zoom in": zoomed(plain, camera, 1.3),
        "zoom out": zoomed(plain, camera, 0.7),
        "flip": flipped(plain),
        "rotate": rotated(plain, np.deg2rad(5.4)),
        "flip, then rotate": rotated(flipped(plain), np.deg2rad(-4)),
        "zoom of a flip": zoomed(flipped(plain), camera, 0.8),
        "everything": flipped(rotated(zoomed(plain, camera, 1.2), np.deg2rad(3))),
    }


@pytest.mark.parametrize("name", list(augmented(RAW)))
@pytest.mark.parametrize("where", [(300.0, 230.0), (380.3, 260.7), (250.5, 251.1)])
def test_content_follows_the_camera(name: str, where: tuple[float, float]) -> None:
    transform = augmented(RAW)[name]
    point = RAW.ego_from_cam.translation + 12 * RAW.rays_ego(np.array(where))
    image = transform.image(dot_image(RAW, np.array(where)))
    camera = transform.camera(RAW)
    assert image.shape == (camera.height_px, camera.width_px, 3)
    expected, depth = camera.project(point)
    margin = 3 * DOT_PX
    assert (expected > margin).all() and (expected < [camera.width_px - margin, camera.height_px - margin]).all()
    # INTER_AREA and 8-bit rounding move a spot by hundredths of a pixel; half a pixel of offset would be a bug
    np.testing.assert_allclose(centroid(image), expected, atol=0.06)
    assert depth == pytest.approx(12)


def test_keeping_the_size_touches_nothing() -> None:
    image = np.random.default_rng(0).integers(0, 256, (400, 640, 3), dtype=np.uint8)
    transform = fit_width(RAW, 640, 400)
    np.testing.assert_array_equal(transform.image(image), image)
    np.testing.assert_array_equal(transform.camera(RAW).K, RAW.K)


def test_a_flip_mirrors_every_pixel() -> None:
    image = np.random.default_rng(0).integers(0, 256, (400, 640, 3), dtype=np.uint8)
    plain = fit_width(RAW, 640, 300)
    np.testing.assert_array_equal(flipped(plain).image(image), plain.image(image)[:, ::-1])


def test_the_bottom_rows_are_kept() -> None:
    front = preset_rig("nuscenes")["CAM_FRONT"]
    transform = fit_width(front, 704, 384)
    assert transform.resized == (704, 396)
    rows = np.repeat(np.arange(396, dtype=np.uint8)[:, None, None] // 2, 704, axis=1).repeat(3, axis=2)
    np.testing.assert_array_equal(transform.image(rows), rows[12:])
    K = transform.camera(front).K
    np.testing.assert_allclose([K[0, 0], K[1, 1], K[0, 2], K[1, 2]], [550, 550, 352, 198 - 12])


def test_an_image_too_low_is_padded_at_the_top() -> None:
    side = preset_rig("waymo")["SIDE_LEFT"]
    transform = fit_width(side, 704, 384)
    assert transform.resized == (704, 325)
    out = transform.image(np.full((886, 1920, 3), 200, dtype=np.uint8))
    assert not out[:59].any() and (out[59:] == 200).all()
    camera = transform.camera(side)
    assert camera.K[1, 2] == pytest.approx(246 * 325 / 886 + 59)
    # what is lowest in the image before is lowest after
    bottom = side.ego_from_cam.translation + 5 * side.rays_ego(np.array([960.0, 886.0]))
    np.testing.assert_allclose(camera.project(bottom)[0], [352, 384])


@pytest.mark.parametrize("ratio", [0.7, 0.94, 1.0, 1.17, 1.4])
def test_zoom_keeps_the_principal_point_and_scales_the_focal_length(ratio: float) -> None:
    plain = fit_width(RAW, 352, 160)
    before, after = plain.camera(RAW), zoomed(plain, RAW, ratio).camera(RAW)
    assert after.focal_px == pytest.approx(ratio * before.focal_px, rel=4e-3)  # sizes are whole pixels
    np.testing.assert_allclose(after.K[:2, 2], before.K[:2, 2], atol=0.5)  # moved by whole pixels
    assert after.ego_from_cam is RAW.ego_from_cam


def test_zooming_out_leaves_a_black_border() -> None:
    plain = fit_width(RAW, 352, 220)
    out = zoomed(plain, RAW, 0.7).image(np.full((400, 640, 3), 90, dtype=np.uint8))
    assert not out[:, :40].any() and not out[:, -40:].any() and (out[100:140, 120:240] == 90).all()


def test_zoom_ratio_must_be_positive() -> None:
    with pytest.raises(ValueError, match="positive"):
        zoomed(fit_width(RAW, 352, 160), RAW, 0.0)


def test_a_pixel_map_is_affine_in_edge_coordinates() -> None:
    # the corners of the image span [0, width] x [0, height], so a resize maps corner to corner
    corner = fit_width(RAW, 320, 200).pixel_map(640, 400) @ np.array([640.0, 400.0, 1.0])
    np.testing.assert_allclose(corner, [320, 200, 1])
