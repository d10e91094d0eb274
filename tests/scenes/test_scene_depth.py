"""Depth of meshes, LiDAR, sky and completion on scenes whose depth can be written down."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scene_shapes import CUBE, GROUND, camera, frame_with
from scipy import sparse
from scipy.sparse.linalg import spsolve

from coin3d.datasets.frame import Frame
from coin3d.geometry import Boxes3D, GroundPlane, Pose, Rig
from coin3d.geometry.mesh import TriangleMesh
from coin3d.scenes.completion import EdgeAwareCompletion, trusted_sources
from coin3d.scenes.ground import local_ground, plane_depth
from coin3d.scenes.lidar_depth import lidar_depth
from coin3d.scenes.ray_cast import RayCaster
from coin3d.scenes.render_depth import BACKGROUND, FrameSurfaces
from coin3d.scenes.seen_view import FROM_COMPLETION, FROM_LIDAR, FROM_MESH, see_frame
from coin3d.scenes.silhouettes import trim_silhouettes
from coin3d.scenes.sky import find_sky
from coin3d.scenes.smooth_fill import smooth_fill
from coin3d.scenes.steep_pixels import snap_steep
from small_world import MemoryLidar


def test_cube_is_closed_and_outside_out() -> None:
    assert CUBE.is_watertight
    assert CUBE.volume_m3 == pytest.approx(1.0)


@settings(max_examples=25)
@given(st.floats(-0.3, 0.5), st.floats(-3, 3), st.floats(-5e4, 5e4))
def test_mesh_depth_of_the_ground_is_that_of_its_plane_wherever_the_world_starts(pitch: float, yaw: float, far: float) -> None:
    cam = camera(pitch, yaw)
    world_from_ego = Pose.from_euler(0.4, 0, 0, [far, -far / 3, 7.0])
    ground = GROUND.transformed(world_from_ego)
    seen = FrameSurfaces(RayCaster(ground), {}, frame_with(Boxes3D.empty(), world_from_ego, cam)).render(cam)
    expected = plane_depth(cam, GroundPlane())
    near = expected < 60
    np.testing.assert_allclose(seen.depth_m[near], expected[near], rtol=4e-3)
    assert (seen.depth_m[~np.isfinite(expected)] == 0).all()
    assert (seen.box == BACKGROUND).all()


def test_objects_stand_in_front_and_name_their_box() -> None:
    boxes = Boxes3D.create(
        [[9, 6, 0.5], [6, 0, 1.5]], [[1, 1, 1], [1, 1, 1]], [0, 0], ["car", "car"], instance_ids=["far", "near"]
    )
    world_from_ego = Pose.from_euler(1.0, 0, 0, [10, 20, 3])
    cam = camera()
    frame = frame_with(boxes, world_from_ego, cam)
    seen = FrameSurfaces(RayCaster(GROUND.transformed(world_from_ego)), {"near": CUBE}, frame).render(cam)
    assert set(np.unique(seen.box)) == {BACKGROUND, 1}, "the box without a mesh is not seen, the other is row 1"
    np.testing.assert_allclose(seen.depth_m[seen.box == 1], 5.0, atol=1e-4)
    # the front face is 1 m wide at 5 m: 12 x 12 pixels
    assert (seen.box == 1).sum() == pytest.approx(144, abs=13)
    behind = plane_depth(cam, GroundPlane())[seen.box == 1]
    np.testing.assert_allclose(seen.background_m[seen.box == 1][behind < 50], behind[behind < 50], rtol=1e-3)


def test_faces_met_from_behind_let_the_ray_pass() -> None:
    inside_out = TriangleMesh.create(CUBE.vertices_m, CUBE.faces[:, ::-1])
    start, ray = np.array([[-3.0, 0.1, 0.2]]), np.array([[2.0, 0, 0]])
    assert RayCaster(CUBE).first_hits(start, ray)[0] == pytest.approx([1.25])
    assert RayCaster(inside_out).first_hits(start, ray)[0] == pytest.approx([1.75], abs=1e-3), "the far wall, from inside"
    assert RayCaster(CUBE).first_hits(start, -ray)[0] == np.inf
    assert RayCaster(TriangleMesh.empty()).first_hits(start, ray)[1] == -1


def test_lidar_depth_leaves_out_what_only_the_lidar_sees() -> None:
    cam = camera()
    wall = np.stack(np.meshgrid([6.0], np.linspace(-1, 1, 60), np.linspace(0.5, 2.5, 60)), -1).reshape(-1, 3)
    over_the_wall = wall * [2, 2, 1] + [0, 0, 0.0]
    depth = lidar_depth(np.concatenate([over_the_wall, wall]), cam)
    u, v = np.floor(cam.project(np.array([[12.0, 0.0, 1.5]]))[0][0]).astype(int)
    assert depth[v, u] == pytest.approx(5.5), "the wall, not what is behind it"
    assert ((depth == 0) | (depth < 6)).reshape(-1)[depth.reshape(-1) < 11].all()
    single = lidar_depth(np.array([[8.5, 0.2, 1.5], [-5, 0, 1]]), cam)
    assert (single > 0).sum() == 1
    assert single.max() == pytest.approx(8.0)


@settings(max_examples=25)
@given(st.integers(0, 10_000))
def test_smooth_fill_solves_its_equations(seed: int) -> None:
    rng = np.random.default_rng(seed)
    h, w = 12, 15
    known, outside = rng.random((h, w)) < 0.2, rng.random((h, w)) < 0.1
    outside &= ~known
    guide, values, prior = rng.random((h, w, 3)), rng.random((h, w)), rng.random((h, w))
    pull = rng.uniform(0.01, 0.1, (h, w))
    filled = smooth_fill(values, known, outside, guide, prior, pull)
    n = h * w
    number = np.arange(n).reshape(h, w)
    matrix, right = sparse.lil_array((n, n)), np.zeros(n)
    for i in range(n):
        y, x = divmod(i, w)
        if known[y, x] or outside[y, x]:
            matrix[i, i], right[i] = 1, values[y, x]
            continue
        matrix[i, i] += pull[y, x]
        right[i] += pull[y, x] * prior[y, x]
        for yy, xx in ((y, x - 1), (y, x + 1), (y - 1, x), (y + 1, x)):
            if 0 <= yy < h and 0 <= xx < w and not outside[yy, xx]:
                weight = np.exp(-np.abs(guide[y, x] - guide[yy, xx]).max() / 0.06) + 1e-3
                matrix[i, i] += weight
                matrix[i, number[yy, xx]] -= weight
    expected = spsolve(matrix.tocsc(), right).reshape(h, w)
    np.testing.assert_allclose(filled, expected, atol=2e-2)
    np.testing.assert_array_equal(filled[known], values[known].astype(np.float32))


def test_smooth_fill_refuses_pixels_without_any_pull() -> None:
    nothing = np.zeros((4, 4), bool)
    with pytest.raises(ValueError, match="prior_weight"):
        smooth_fill(np.zeros((4, 4)), nothing, nothing, np.zeros((4, 4, 3)), np.zeros((4, 4)), np.zeros((4, 4)))


def test_completion_continues_a_plane_across_a_hole_and_never_digs() -> None:
    cam = camera(width=160, height=96)
    truth = np.minimum(plane_depth(cam, GroundPlane()), 30.0)
    sparse_m = truth.copy()
    sparse_m[60:85, 50:110] = 0
    rgb = np.full((96, 160, 3), 100, np.uint8)
    dense = EdgeAwareCompletion()(rgb, sparse_m, np.zeros(truth.shape, bool), cam, GroundPlane())
    np.testing.assert_allclose(dense, truth, rtol=0.03)
    nothing = EdgeAwareCompletion()(rgb, 0 * truth, np.zeros(truth.shape, bool), cam, GroundPlane())
    near = plane_depth(cam, GroundPlane()) < 20
    assert (nothing[near] <= plane_depth(cam, GroundPlane())[near] + 1e-3).all()
    assert np.isfinite(nothing).all()


def test_completion_steps_where_the_image_does() -> None:
    cam = camera(pitch_rad=-0.5, width=120, height=60)
    rgb = np.full((60, 120, 3), 60, np.uint8)
    rgb[:, 60:] = 200
    sparse_m = np.zeros((60, 120))
    sparse_m[:, :30], sparse_m[:, 90:] = 5.0, 40.0
    dense = EdgeAwareCompletion()(rgb, sparse_m, np.zeros((60, 120), bool), cam, GroundPlane())
    assert (np.abs(dense[:, 31:58] - 5) < 0.5).all()
    assert (dense[:, 62:90] > 25).all()


def test_rims_of_solid_regions_are_no_sources_but_thin_ones_are() -> None:
    known = np.zeros((60, 400), bool)
    known[10:40, 100:200] = True
    known[50, 20:80] = True
    sources = trusted_sources(known)
    assert sources[12:38, 102:198].all()
    assert not sources[10, 100:200].any()
    assert sources[50, 20:80].all()


def test_sky_is_even_bright_above_the_horizon_and_not_a_wall() -> None:
    cam = camera(width=200, height=120)
    rgb = np.full((120, 200, 3), (70, 70, 75), np.uint8)
    rgb[:50, :120] = (150, 180, 215)
    rgb[:90, 120:] = (205, 205, 205)  # a bright wall up to the top of the image
    depth = np.zeros((120, 200))
    depth[30:, 120:] = 12.0
    sky = find_sky(rgb, depth, cam, GroundPlane())
    assert sky[:45, :112].mean() > 0.97
    assert not sky[:, 124:].any()
    assert not sky[60:].any()
    assert not find_sky((rgb * 0.3).astype(np.uint8), depth, cam, GroundPlane()).any(), "nights have no sky"


def test_ramps_between_surfaces_become_steps() -> None:
    depth = np.full((40, 200), 30.0, np.float32)
    depth[:, :100] = 6.0
    depth[:, 100:104] = [7.5, 10, 15, 24]
    free = np.zeros(depth.shape, bool)
    free[:, 98:106] = True
    snapped = snap_steep(depth, free)
    assert set(np.unique(snapped.round(3))) == {6.0, 30.0}
    np.testing.assert_array_equal(snap_steep(depth, ~free), depth)
    cam = camera(width=400, height=225).transformed(np.diag([5.0, 5.0, 1]) @ np.eye(3), 400, 225)
    street = np.minimum(plane_depth(cam, GroundPlane()), 100).astype(np.float32)
    near = street < 30
    np.testing.assert_array_equal(snap_steep(street, street > 0)[near], street[near])


def test_silhouettes_move_to_the_edge_of_the_image() -> None:
    rgb = np.full((90, 200, 3), 210, np.uint8)
    rgb[30:60, 80:120] = (40, 60, 120)
    depth = np.full((90, 200), 20.0, np.float32)
    depth[26:64, 76:124] = 5.0
    meshed = np.ones(depth.shape, bool)
    trimmed = trim_silhouettes(rgb, depth, meshed, np.zeros_like(meshed), 150.0, 0.15)
    should = np.zeros_like(meshed)
    should[30:60, 80:120] = True
    assert ((trimmed.depth_m < 10) != should).sum() <= 4 * 4, "corners at most"
    assert (trimmed.depth_m[trimmed.moved] == 20).all()
    kept = trim_silhouettes(rgb, depth, meshed, depth < 10, 150.0, 0.15)
    assert not kept.moved.any(), "LiDAR says otherwise"


def test_measured_depth_is_kept_and_every_pixel_gets_one() -> None:
    cam = camera(width=96, height=64)
    boxes = Boxes3D.create([[8, 0, 0.5]], [[1, 1, 1]], [0], ["car"], instance_ids=["a"])
    frame = frame_with(boxes, Pose.identity(), cam)
    half = TriangleMesh.create([[0, -50, 0], [50, -50, 0], [50, 0, 0], [0, 0, 0]], [[0, 1, 2], [0, 2, 3]])
    returns = np.array([[12.0, 3.0, 0.0], [15.0, 5.0, 0.0]])
    frame = Frame("f", 0, frame.rig, frame.images, boxes_world=boxes, lidar=MemoryLidar(returns))
    surfaces = FrameSurfaces(RayCaster(half), {"a": CUBE}, frame)
    (view,) = see_frame(frame, surfaces, GroundPlane(), EdgeAwareCompletion(), 800)
    mesh = surfaces.render(cam)
    assert (view.depth_m > 0).all()
    still = view.source == FROM_MESH
    assert still.sum() > 0.9 * (mesh.depth_m > 0).sum()
    np.testing.assert_array_equal(view.depth_m[still], mesh.depth_m[still])
    assert (view.source == FROM_LIDAR).sum() == 2
    assert view.depth_m[view.source == FROM_LIDAR] == pytest.approx([14.5, 11.5], abs=0.01)
    assert (view.source == FROM_COMPLETION).any()
    assert view.near_object[view.box == 0].all()
    assert view.near_object.sum() > (view.box == 0).sum()


def test_a_completion_that_fails_is_named() -> None:
    cam = camera()
    frame = frame_with(Boxes3D.empty(), Pose.identity(), cam)
    surfaces = FrameSurfaces(RayCaster(TriangleMesh.empty()), {}, frame)

    def broken(rgb: np.ndarray, sparse_depth_m: np.ndarray, *_: object) -> np.ndarray:
        return np.full_like(sparse_depth_m, np.nan)

    with pytest.raises(ValueError, match="eye: depth completion"):
        see_frame(frame, surfaces, GroundPlane(), broken, 800)


def test_ground_is_fitted_only_where_it_is_well_supported() -> None:
    cam = camera()
    rng = np.random.default_rng(0)
    street = np.column_stack([rng.uniform(-15, 15, (4000, 2)), rng.normal(0.2, 0.01, 4000)])
    frame = Frame("f", 0, Rig({"eye": cam}), {"eye": np.zeros((48, 80, 3), np.uint8)}, lidar=MemoryLidar(street))
    assert float(local_ground(frame).height_m(np.zeros(3))) == pytest.approx(-0.2, abs=0.01)
    without = Frame("f", 0, frame.rig, frame.images)
    assert local_ground(without) is frame.rig.ground
