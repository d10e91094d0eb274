"""The native renderer against its definition in float64, and by hand; every instruction set of the machine is tried."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coin3d import native
from coin3d.geometry import Camera, Lens, Pose, camera_pose
from coin3d.rendering import Gaussians, Rendering, prepare, render
from coin3d.rendering.cpu import instruction_sets, render_cpu
from coin3d.rendering.reference import ExactRendering, render_reference
from coin3d.rendering.view import MAX_ALPHA, slope_limits

# Single precision may decide otherwise than double where alpha meets 1/255 or transmittance meets 1e-4: one such decision
# moves a colour by up to 2.5 levels. Everywhere else the 8-bit colour is the rounded reference or its neighbour.
LEVELS, LEVELS_ANYWHERE, PIXEL_BUDGET = 1.0, 4.0, 0.0005
ALL_SETS = pytest.mark.parametrize("instruction_set", instruction_sets())


def scene(rows: list[tuple[tuple[float, float, float], float, tuple[int, int, int]]]) -> Gaussians:
    """From (centre, std, colour) in the camera frame of ``front_camera``, which is also the ego frame."""
    centre, std, rgb = zip(*rows, strict=True)
    return Gaussians(np.array(centre, np.float32), np.array(std, np.float32), np.array(rgb, np.uint8))


def front_camera(width: int = 16, height: int = 12, focal: float = 20) -> Camera:
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    return Camera(K, width, height, Pose.identity())


def assert_parity(ours: Rendering, exact: ExactRendering, scale_m: float) -> None:
    """Within 1/255 apart from the budget; depth relative to the farthest splat."""
    rgb = np.abs(ours.rgb - exact.rgb * 255).max(-1)
    alpha = np.abs(ours.alpha - exact.alpha) * 255
    depth = np.abs(ours.depth_m - exact.depth_m) / scale_m * 255
    beyond = (rgb > LEVELS) | (alpha > LEVELS) | (depth > LEVELS)
    assert beyond.sum() <= max(2, PIXEL_BUDGET * beyond.size), f"{beyond.sum()} of {beyond.size} pixels differ"
    assert max(rgb.max(), alpha.max(), depth.max()) <= LEVELS_ANYWHERE


def random_scene(seed: int, n: int, largest_m: float) -> Gaussians:
    rng = np.random.default_rng(seed)
    centre = rng.uniform([-3, -8, -2], [25, 8, 5], (n, 3)).astype(np.float32)
    std = np.exp(rng.uniform(np.log(1e-3), np.log(largest_m), n)).astype(np.float32)
    return Gaussians(centre, std, rng.integers(0, 256, (n, 3)).astype(np.uint8))


def random_camera(seed: int, width: int, height: int) -> Camera:
    """Any principal point (also outside the image), skew, unequal and negative focal lengths."""
    rng = np.random.default_rng(seed)
    focal = rng.uniform(0.4, 2, 2) * width * rng.choice([-1, 1], 2)
    K = np.array([[focal[0], rng.normal() * 5, 0], [rng.normal() * 5, focal[1], 0], [0, 0, 1]])
    K[:2, 2] = rng.uniform(-0.3, 1.3, 2) * (width, height)
    yaw, pitch, roll = rng.normal(size=3) * (1, 0.2, 0.5)
    return Camera(K, width, height, camera_pose(rng.normal(size=3) + np.array([0, 0, 1.5]), yaw, pitch, roll))


@settings(max_examples=20)
@given(st.integers(0, 10**6), st.integers(0, 500), st.integers(1, 70), st.integers(1, 60), st.sampled_from([0.02, 0.3, 3.0]))
def test_every_instruction_set_equals_the_definition(seed: int, n: int, width: int, height: int, largest_m: float) -> None:
    gaussians, camera = random_scene(seed, n, largest_m), random_camera(seed + 1, width, height)
    exact = render_reference(gaussians, camera)
    for kind in instruction_sets():
        (ours,) = render_cpu(gaussians, [camera], instruction_set=kind)
        assert_parity(ours, exact, scale_m=30)


def dense_wall(columns: int = 200, rows: int = 120) -> Gaussians:
    """A wall at 8 m with a nearer half, one small Gaussian per cell, in tiles of 16x16 cells."""
    v, u = np.mgrid[:rows, :columns]
    order = np.lexsort((u.ravel(), v.ravel(), u.ravel() // 16, v.ravel() // 16))
    u, v = u.ravel()[order] / columns, v.ravel()[order] / rows
    centre = np.stack([np.where(u < 0.4, 5, 8) + 0.3 * v, (0.5 - u) * 10, (0.5 - v) * 6 + 1.5], axis=1)
    rgb = np.stack([255 * u, 255 * v, 255 * (u * 7 % 1)], axis=1)
    return Gaussians(centre.astype(np.float32), np.full(len(u), 0.02, np.float32), rgb.astype(np.uint8))


def test_a_dense_wall_equals_the_definition() -> None:
    wall = dense_wall(70, 40)
    K = np.array([[65.0, 0, 31.3], [0, 65, 20.1], [0, 0, 1]])
    camera = Camera(K, 67, 41, camera_pose([0.1, 0.2, 1.4], 0.05, 0.02, 0.01))
    exact = render_reference(wall, camera)
    assert exact.alpha.mean() > 0.5
    for kind in instruction_sets():
        assert_parity(render_cpu(wall, [camera], instruction_set=kind)[0], exact, scale_m=10)


@ALL_SETS
def test_any_number_of_threads_gives_the_same_bits(instruction_set: str) -> None:
    cameras = [random_camera(s, 150 + 13 * s, 90 + s) for s in range(3)]
    gaussians = Gaussians.concatenate([dense_wall(), random_scene(0, 3000, 0.5)])
    once = [render_cpu(gaussians, [c], instruction_set=instruction_set)[0] for c in cameras]
    for threads in (1, 2, 3, 7):
        for a, b in zip(once, render_cpu(gaussians, cameras, threads=threads, instruction_set=instruction_set), strict=True):
            assert all(x.tobytes() == y.tobytes() for x, y in zip(vars(a).values(), vars(b).values(), strict=True))


def test_calls_at_the_same_time_do_not_disturb_each_other() -> None:
    prepared, cameras = prepare(dense_wall()), [random_camera(s, 160, 96) for s in range(4)]
    alone = render(prepared, cameras)
    at_once: dict[int, Rendering] = {}

    def work(i: int) -> None:
        for _ in range(3):
            at_once[i] = render(prepared, [cameras[i]])[0]

    threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(at_once[i].rgb.tobytes() == alone[i].rgb.tobytes() for i in range(4))


@ALL_SETS
def test_one_splat_by_hand(instruction_set: str) -> None:
    # std 0.1 m at 2 m and focal length 20 is one pixel; 0.3 px^2 are added
    gaussians = scene([((0.05, 0.05, 2), 0.1, (255, 100, 0))])
    (ours,) = render_cpu(gaussians, [front_camera()], instruction_set=instruction_set)
    u, v = 8.5, 6.5  # the centre of pixel (8, 6)
    slope = 0.025
    for x, y in ((8, 6), (9, 6), (8, 8), (6, 5)):
        dx, dy = x + 0.5 - u, y + 0.5 - v
        on, off = 1 + slope**2 + 0.3, slope**2  # J J^T is I + slope slope^T
        q = (on * dx * dx - 2 * off * dx * dy + on * dy * dy) / (on**2 - off**2)
        alpha = min(0.99, np.exp(-q / 2))
        assert ours.alpha[y, x] == pytest.approx(alpha, rel=5e-5)
        assert ours.depth_m[y, x] == pytest.approx(2 * alpha, rel=5e-5)
        assert np.abs(ours.rgb[y, x] - np.array([255, 100, 0]) * alpha).max() < 0.51
    assert ours.alpha[6, 8] == pytest.approx(0.99) and ours.alpha[0, 0] == 0 and ours.rgb[0, 0].max() == 0


@ALL_SETS
def test_the_nearer_splat_covers_the_farther_one_and_equal_depth_goes_by_row(instruction_set: str) -> None:
    red, green = (255, 0, 0), (0, 255, 0)
    far_first = scene([((0, 0, 3), 0.5, red), ((0, 0, 2), 0.5, green)])
    equal = scene([((0, 0, 2), 0.5, red), ((0, 0, 2), 0.5, green)])
    for gaussians, front in ((far_first, 1), (equal, 0), (equal[::-1], 1)):
        (ours,) = render_cpu(gaussians, [front_camera()], instruction_set=instruction_set)
        assert ours.rgb[6, 8, front] > 240 and ours.rgb[6, 8, 1 - front] < 10


@ALL_SETS
def test_many_duplicates_at_equal_depth_stop_where_the_definition_does(instruction_set: str) -> None:
    rng = np.random.default_rng(0)
    rows = [((0.0, 0.0, 2.0), 0.3, tuple(int(c) for c in rng.integers(0, 256, 3))) for _ in range(400)]
    gaussians = scene(rows)
    assert_parity(
        render_cpu(gaussians, [front_camera()], instruction_set=instruction_set)[0],
        render_reference(gaussians, front_camera()), scale_m=2,
    )  # fmt: skip


@ALL_SETS
def test_depths_that_differ_in_the_last_bit_are_kept_in_order(instruction_set: str) -> None:
    """All but one fall into the same bucket of the sort, in reverse order."""
    rng = np.random.default_rng(3)
    z = [np.float32(2)]
    for _ in range(299):
        z.append(np.nextafter(z[-1], np.float32(0)))
    rows = [((0.0, 0.0, float(d)), 0.2, tuple(int(c) for c in rng.integers(0, 256, 3))) for d in [1000.0, *z]]
    gaussians, camera = scene(rows), front_camera()
    assert_parity(
        render_cpu(gaussians, [camera], instruction_set=instruction_set)[0], render_reference(gaussians, camera), scale_m=2
    )


@ALL_SETS
def test_one_splat_can_fill_the_image(instruction_set: str) -> None:
    camera = front_camera(130, 70)
    for std_m in (100.0, 1e30):
        (ours,) = render_cpu(scene([((0, 0, 1), std_m, (10, 20, 30))]), [camera], instruction_set=instruction_set)
        assert np.unique(ours.rgb.reshape(-1, 3), axis=0).tolist() == [[10, 20, 30]]
        np.testing.assert_allclose(ours.alpha, MAX_ALPHA, rtol=1e-6)


@ALL_SETS
def test_splats_behind_on_and_just_before_the_camera_plane(instruction_set: str) -> None:
    unseen = scene([((0, 0, z), 0.5, (255, 255, 255)) for z in (-2, -1e-6, 0, 1e-6, 0.2)] + [((3, 0, 0), 0.5, (9, 9, 9))])
    (ours,) = render_cpu(unseen, [front_camera()], instruction_set=instruction_set)
    assert ours.alpha.max() == 0
    just_seen = scene([((0, 0, 0.201), 0.5, (255, 255, 255))])
    (ours,) = render_cpu(just_seen, [front_camera()], instruction_set=instruction_set)
    assert ours.alpha.min() > 0.9


@ALL_SETS
def test_coordinates_beyond_single_precision_do_no_harm(instruction_set: str) -> None:
    gaussians = scene([((1e38, -1e38, 1e38), 1e38, (255, 0, 0)), ((0, 0, 3e38), 1, (255, 0, 0)), ((0, 0, 2), 0.5, (0, 255, 0))])
    (ours,) = render_cpu(gaussians, [front_camera()], instruction_set=instruction_set)
    assert ours.rgb[6, 8, 1] > 240 and np.isfinite(ours.depth_m).all()


@ALL_SETS
def test_images_wider_than_a_thousand_pixels_and_one_pixel_high(instruction_set: str) -> None:
    camera = Camera(np.array([[1500.0, 0, 2500], [0, 1500, 0.5], [0, 0, 1]]), 5000, 1, Pose.identity())
    gaussians = scene([((x, 0, 10), 0.01, (255, 255, 255)) for x in np.linspace(-16, 16, 50)])
    (ours,) = render_cpu(gaussians, [camera], instruction_set=instruction_set)
    assert_parity(ours, render_reference(gaussians, camera), scale_m=10)
    lit = np.flatnonzero(ours.alpha[0] > 0.4)
    assert lit.min() < 110 and lit.max() > 4890


def test_an_empty_scene_and_no_cameras() -> None:
    (ours,) = render(Gaussians.empty(), [front_camera()], threads=2)
    assert ours.rgb.max() == 0 and ours.alpha.max() == 0 and ours.depth_m.max() == 0
    assert render(dense_wall(), []) == []


@settings(max_examples=20)
@given(st.integers(0, 10**6), st.sampled_from([0.01, 1.0]))
def test_culling_a_chunk_never_removes_what_is_seen(seed: int, largest_m: float) -> None:
    """With one Gaussian per call the sphere is tight; among 256 of all places nothing is culled."""
    gaussians, camera = random_scene(seed, 40, largest_m), random_camera(seed, 40, 30)
    alone = sum(render(gaussians[i : i + 1], [camera])[0].alpha.sum() > 0 for i in range(40))
    exact = sum(render_reference(gaussians[i : i + 1], camera).alpha.sum() > 1e-4 for i in range(40))
    assert abs(alone - exact) <= 1  # a splat whose alpha is 1/255 at one pixel


def test_depth_is_that_of_the_surface() -> None:
    (ours,) = render(
        dense_wall(), [Camera(np.array([[60.0, 0, 40], [0, 60, 25], [0, 0, 1]]), 80, 50, camera_pose([0, 0, 1.5]))]
    )
    front, back = ((ours.depth_m / np.maximum(ours.alpha, 1e-6))[25, u] for u in (10, 60))
    assert 5 < front < 5.4 and 8 < back < 8.4


class _Fisheye:
    def plane_from_ray(self, rays_cam: np.ndarray) -> np.ndarray:
        return rays_cam[..., :2]

    def ray_from_plane(self, plane: np.ndarray) -> np.ndarray:
        return np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1)


def test_what_cannot_be_rendered_is_said() -> None:
    lens: Lens = _Fisheye()
    camera = front_camera()
    fisheye = Camera(camera.K, 16, 12, camera.ego_from_cam, lens)
    with pytest.raises(ValueError, match=r"camera 1 of 2 has the lens .* pinhole cameras only"):
        render(dense_wall(), [camera, fisheye])
    with pytest.raises(ValueError, match="at least one thread, got 0"):
        render(dense_wall(), [camera], threads=0)
    with pytest.raises(ValueError, match="cannot run the instruction set 'mmx'"):
        render_cpu(dense_wall(), [camera], instruction_set="mmx")


def test_native_code_checks_the_shapes_it_is_given() -> None:
    g = random_scene(0, 10, 1)
    out = [np.zeros((4, 5, 3), np.uint8)], [np.zeros((4, 5), np.float32)], [np.zeros((4, 5), np.float32)]
    row = np.zeros((1, 24))
    row[0, 22:] = 5, 4
    bounds = prepare(g).bounds
    with pytest.raises(ValueError, match="wrong shape of bounds"):
        native.splat_render(g.centre_m, g.std_m, g.rgb, bounds[:0], row, *out, 1, "baseline")
    with pytest.raises(ValueError, match="centre and rgb"):
        native.splat_render(g.centre_m, g.std_m, g.rgb[:5], bounds, row, *out, 1, "baseline")
    row[0, 23] = 6
    with pytest.raises(ValueError, match="wrong shape of an image"):
        native.splat_render(g.centre_m, g.std_m, g.rgb, bounds, row, *out, 1, "baseline")


def test_limits_of_a_centred_camera_are_the_usual_ones() -> None:
    limits = slope_limits(front_camera(16, 12, 20))
    tangent = 8 / 20, 6 / 20
    assert (limits.x_min, limits.x_max) == pytest.approx((-1.3 * tangent[0], 1.3 * tangent[0]))
    assert (limits.y_min, limits.y_max) == pytest.approx((-1.3 * tangent[1], 1.3 * tangent[1]))


def test_ten_million_splats() -> None:
    rng = np.random.default_rng(0)
    n, camera = 10_000_000, front_camera(320, 240, 300)
    depth_m = rng.uniform(20, 60, n).astype(np.float32)
    slope = rng.uniform(-0.6, 0.6, (2, n)).astype(np.float32)
    rgb = np.zeros((n, 3), np.uint8)
    rgb[:, 0] = np.where(depth_m < 30, 250, 40)
    crowd = Gaussians(np.stack([*(slope * depth_m), depth_m], axis=1), np.full(n, 0.1, np.float32), rgb)
    (alone,) = render(crowd, [camera], threads=2)
    assert (alone.alpha >= np.float32(MAX_ALPHA)).all() and (alone.rgb[..., 1:] == 0).all()
    surface_m = alone.depth_m / alone.alpha
    assert surface_m.min() >= 20 and surface_m.max() < 30, "of thousands of splats in a pixel the near ones are seen"
    assert alone.rgb[..., 0].min() > 240
    door = scene([((0, 0, 5), 50.0, (0, 0, 200))])
    (closed,) = render(Gaussians.concatenate([crowd, door]), [camera], threads=2)
    assert (closed.rgb[..., 2] > 190).all() and closed.depth_m.max() < 5.3
