"""What images do not show: hidden background, unseen sides of objects, the ground under the vehicle; and the Gaussians."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scene_shapes import CUBE, GROUND, camera, frame_with

from coin3d.datasets.frame import Frame
from coin3d.geometry import Boxes3D, GroundPlane, Pose, Rig
from coin3d.geometry.mesh import TriangleMesh
from coin3d.rendering import Gaussians, render
from coin3d.scenes.assemble import SplatRadii, blind_gaussians, tile_order, view_gaussians
from coin3d.scenes.back_layer import BackLayer
from coin3d.scenes.backing import continue_behind
from coin3d.scenes.blind_area import Neighbour, blind_colours, blind_points, lend_colours
from coin3d.scenes.colour_lookup import NearestColours, Sightings, contradicted, look_up, shown
from coin3d.scenes.completion import EdgeAwareCompletion
from coin3d.scenes.inpainting import FastMarchingInpainting
from coin3d.scenes.object_points import model_objects, unseen_points
from coin3d.scenes.ray_cast import RayCaster
from coin3d.scenes.render_depth import BACKGROUND, FrameSurfaces, ego_from_box
from coin3d.scenes.revealed import hidden_background
from coin3d.scenes.seen_view import FROM_COMPLETION, FROM_MESH, FROM_SKY, SeenView, see_frame
from coin3d.scenes.sharpen import sharpened
from coin3d.scenes.surface_samples import sample_surface
from coin3d.scenes.views import pixel_rays_ego
from small_world import MemoryLidar, ring_rig

BOX = Boxes3D.create([[6, 0.2, 0.5]], [[1, 1, 1]], [0], ["car"], instance_ids=["a"])


def flat_view(depth_m: float = 10.0, rgb: tuple[int, int, int] = (90, 120, 150)) -> SeenView:
    """A wall that fills the image."""
    cam = camera()
    shape = (cam.height_px, cam.width_px)
    return SeenView(
        "eye",
        cam,
        np.full((*shape, 3), rgb, np.uint8),
        np.full(shape, depth_m, np.float32),
        np.full(shape, FROM_MESH, np.uint8),
        np.full(shape, BACKGROUND, np.int32),
        np.full(shape, depth_m, np.float32),
    )


def street_frames(count: int = 3, step_m: float = 1.0) -> list[tuple[Frame, list[SeenView], FrameSurfaces]]:
    """A rig of three cameras that drives along a street whose colours are a function of the place."""
    rig, out = ring_rig(3), []
    for k in range(count):
        world_from_ego = Pose.from_euler(0, 0, 0, [k * step_m, 0, 0])
        images = {}
        for name, cam in rig.items():
            rays = pixel_rays_ego(cam)
            down = np.minimum(rays[..., 2], -1e-3)
            at = world_from_ego.apply(cam.ego_from_cam.translation - rays * (cam.ego_from_cam.translation[2] / down)[..., None])
            images[name] = np.where(rays[..., 2:] < 0, paint(at), 240).astype(np.uint8)
        frame = Frame(f"f{k}", k, rig, images, world_from_ego, Boxes3D.empty(), MemoryLidar(np.zeros((0, 3))))
        surfaces = FrameSurfaces(RayCaster(GROUND), {}, frame)
        out.append((frame, see_frame(frame, surfaces, GroundPlane(), EdgeAwareCompletion(), 800), surfaces))
    return out


def paint(world: np.ndarray) -> np.ndarray:
    return np.stack([120 + 60 * np.sin(world[..., 0] / 2), 120 + 60 * np.cos(world[..., 1] / 2), 0 * world[..., 0] + 80], -1)


def test_far_surfaces_go_on_behind_near_edges() -> None:
    depth = np.full((9, 20), 20.0, np.float32)
    depth[:, 10:] = 5.0
    rgb = np.zeros((9, 20, 3), np.uint8)
    rgb[:, :10], rgb[:, 10:] = 50, 200
    band = continue_behind(depth, rgb, 4)
    np.testing.assert_array_equal(np.flatnonzero(band.mask[4]), [10, 11, 12, 13])
    assert (band.depth_m[band.mask] == 20).all()
    assert (band.rgb[band.mask] == 50).all()
    np.testing.assert_array_equal(band.distance_px[4, 10:14], [1, 2, 3, 4])
    slope = np.linspace(5, 6, 20, dtype=np.float32)[None].repeat(9, 0)
    assert not continue_behind(slope, rgb, 4).mask.any()


def test_inpainting_continues_the_surroundings() -> None:
    rgb = np.full((60, 80, 3), (200, 30, 30), np.uint8)
    rgb[:30] = (30, 30, 200)
    mask = np.zeros((60, 80), bool)
    mask[20:40, 30:50] = True
    spoilt = np.where(mask[..., None], np.uint8(255), rgb)
    filled = FastMarchingInpainting()(spoilt, mask)
    np.testing.assert_array_equal(filled[~mask], rgb[~mask])
    assert np.abs(filled[21:26, 32:48].astype(int) - (30, 30, 200)).max() < 40
    assert np.abs(filled[34:39, 32:48].astype(int) - (200, 30, 30)).max() < 40


def test_behind_an_object_is_the_street() -> None:
    cam = camera()
    front, back = GROUND.vertices_m.copy(), GROUND.vertices_m.copy()
    front[[1, 2], 0], back[[0, 3], 0] = 6.0, 9.0
    with_hole = TriangleMesh.concatenate([TriangleMesh.create(part, GROUND.faces) for part in (front, back)])
    for street in (GROUND, with_hole):
        frame = frame_with(BOX, Pose.identity(), cam)
        surfaces = FrameSurfaces(RayCaster(street), {"a": CUBE}, frame)
        (view,) = see_frame(frame, surfaces, GroundPlane(), EdgeAwareCompletion(), 800)
        layer = hidden_background(view, frame, GroundPlane(), EdgeAwareCompletion(), FastMarchingInpainting())
        assert layer.mask[view.box == 0].mean() > 0.7, "all but what touches the street"
        expected = 1.5 / np.maximum(-pixel_rays_ego(cam)[..., 2], 1e-9)
        near = layer.mask & (expected < 15)
        assert near.any()
        assert np.abs(layer.depth_m[near] / expected[near] - 1).max() < 0.05


def test_colours_are_looked_up_only_where_depth_object_and_side_agree() -> None:
    view = flat_view(10.0)
    ahead = view.camera.ego_from_cam.translation + np.array([[10.0, 0, 0], [10.3, 0, 0], [9.0, 0, 0], [-5, 0, 0]])
    assert look_up(view, ahead, BACKGROUND, 0.1).row.tolist() == [0]
    assert look_up(view, ahead, BACKGROUND, 0.1, 0.05).row.tolist() == [0, 1]
    assert look_up(view, ahead, 0, 0.1).row.tolist() == []
    away = np.array([[1.0, 0, 0]] * 4)
    assert look_up(view, ahead, BACKGROUND, 0.1, normals_ego=away).row.tolist() == []
    assert look_up(view, ahead, BACKGROUND, 0.1, normals_ego=-away).rgb.tolist() == [[90, 120, 150]]


def test_the_nearest_sightings_are_kept() -> None:
    colours = NearestColours(2, 2)
    for depth_m, value in ((9.0, 90), (3.0, 30), (6.0, 60), (12.0, 120)):
        colours.add(Sightings(np.array([0]), np.array([depth_m]), np.full((1, 3), value, np.uint8)))
    assert colours.found.tolist() == [True, False]
    assert colours.mean().tolist() == [[45, 45, 45], [0, 0, 0]]


def test_points_peeping_out_behind_an_edge_count_as_shown() -> None:
    view = flat_view(30.0)
    view.depth_m[:, :40] = 5.0
    start, rays = view.camera.ego_from_cam.translation, pixel_rays_ego(view.camera)
    points = start + 20 * rays[24, [20, 39, 45]]
    assert shown(points, [view], 0.1).tolist() == [False, True, True]


def test_guesses_give_way_to_what_another_camera_knows() -> None:
    guess, known = flat_view(5.0), flat_view(20.0)
    guess.source[:, :40] = FROM_COMPLETION
    np.testing.assert_array_equal(contradicted(guess, [guess, known]), guess.source == FROM_COMPLETION)
    known.source[:] = FROM_COMPLETION
    assert not contradicted(guess, [guess, known]).any()


@given(st.integers(0, 1000), st.floats(0.03, 0.08))
@settings(max_examples=20)
def test_surface_samples_are_even_and_any_part_covers_all(seed: int, spacing: float) -> None:
    samples = sample_surface(CUBE, spacing, 10**6, seed)
    assert len(samples.points_m) == round(6 / spacing**2)
    np.testing.assert_allclose(np.abs(samples.points_m).max(1), 0.5, atol=1e-6)
    np.testing.assert_allclose(np.einsum("ij,ij->i", samples.points_m, samples.normals), 0.5, atol=1e-6)
    part = samples.normals[: len(samples.normals) // 2]
    shares = [(part @ axis > 0.9).mean() for axis in np.concatenate([np.eye(3), -np.eye(3)])]
    assert min(shares) > 1 / 12 and max(shares) < 1 / 3
    np.testing.assert_array_equal(samples.points_m, sample_surface(CUBE, spacing, 10**6, seed).points_m)


def test_unseen_sides_take_colours_of_other_frames_and_of_their_mirror_image() -> None:
    """The right side of the box is seen red in frame 0; from frame 1 it is hidden and its left side unseen anywhere."""
    cam = camera()
    boxes = [Boxes3D.create([[6, y, 0.5]], [[1, 1, 1]], [0], ["car"], instance_ids=["a"]) for y in (3.0, 0.2)]
    frames, views = [], {}
    for k, table in enumerate(boxes):
        frame = frame_with(table, Pose.identity(), cam)
        frame = Frame(f"f{k}", k, frame.rig, frame.images, Pose.identity(), table)
        (view,) = see_frame(
            frame, FrameSurfaces(RayCaster(GROUND), {"a": CUBE}, frame), GroundPlane(), EdgeAwareCompletion(), 800
        )
        right = (view.box == 0) & (k == 0) & (np.abs(view.depth_m - view.depth_m[view.box == 0].min()) > 0.05)
        rgb = np.where(right[..., None], np.uint8([250, 0, 0]), np.uint8([10, 10, 200]))
        views[frame.token] = [SeenView(view.name, cam, rgb, view.depth_m, view.source, view.box, view.behind_m)]
        frames.append(frame)
    models = model_objects({"a": CUBE}, frames, lambda f: views[f.token], 800)
    model = models["a"]
    side, rear = np.abs(model.points_m[:, 1]) > 0.499, model.points_m[:, 0] < -0.499
    assert (model.rgb[side & (np.abs(model.points_m[:, 0]) < 0.4), 0] > 200).mean() > 0.8, "both sides, by mirroring"
    assert (model.rgb[rear, 2] > 150).mean() > 0.6
    assert model.points_m[:, 2].min() > -0.5, "no underside"
    unseen = unseen_points(models, frames[1], views["f1"], 60.0)
    local = ego_from_box(frames[1], 0).inverse().apply(unseen.centre_m)
    assert not (np.abs(local[:, 0] + 0.5) < 0.01)[(np.abs(local[:, 1:]) < 0.4).all(1)].any(), "the rear is in the image"
    assert (np.abs(local[:, 0] - 0.5) < 0.01).any(), "the front is not"
    assert not len(unseen_points(models, frames[1], views["f1"], 2.0))


def test_the_blind_area_is_what_no_camera_sees_in_the_colours_of_other_frames() -> None:
    frames = street_frames()
    frame, views, surfaces = frames[1]
    points = blind_points(frame.rig, GroundPlane(), surfaces, 0.1)
    assert len(points) > 300
    assert not frame.rig.sees(points).any()
    np.testing.assert_allclose(points[:, 2], 0, atol=1e-4)
    assert (np.linalg.norm(points[:, :2], axis=1) < 12).all()
    neighbours = [Neighbour(f, v) for f, v, _ in (frames[0], frames[2])]
    rgb = blind_colours(points, frame, views, neighbours, GroundPlane())
    world = frame.world_from_ego.apply(points)
    assert np.median(np.abs(rgb - paint(world)).max(1)) < 12
    alone = blind_colours(points, frame, views, [], GroundPlane())
    assert alone.min() > 20, "continued from beside, never black"
    still = [Neighbour(frame, [])]
    np.testing.assert_array_equal(blind_colours(points, frame, views, still, GroundPlane()), alone)


def test_blind_points_follow_the_street_and_its_slope() -> None:
    frame = street_frames(1)[0][0]
    plane = GroundPlane(np.array([-0.05, 0, 1.0]), 0.1)
    corners = [[a, b, 0.05 * a - 0.02] for a, b in ((-50, -50), (50, -50), (50, 50), (-50, 50))]
    high = TriangleMesh.create(corners, [[0, 1, 2], [0, 2, 3]])
    surfaces = FrameSurfaces(RayCaster(high), {}, frame)
    points = blind_points(frame.rig, plane, surfaces, 0.2)
    np.testing.assert_allclose(points[:, 2], 0.05 * points[:, 0] - 0.02, atol=1e-3)
    bare = blind_points(frame.rig, plane, FrameSurfaces(RayCaster(TriangleMesh.empty()), {}, frame), 0.2)
    np.testing.assert_allclose(plane.height_m(bare), 0, atol=1e-9)


def test_lent_colours_are_those_beside() -> None:
    known = np.array([[0.0, 0, 0], [10, 0, 0]])
    rgb = lend_colours(np.array([[0.01, 0, 5.0], [9.9, 0, 0]]), known, np.array([[200, 0, 0], [0, 200, 0]], np.uint8))
    assert rgb[0, 0] > 190 and rgb[1, 1] > 190


def test_gaussians_are_the_pixels_at_their_depth_in_tile_order() -> None:
    view = flat_view(8.0)
    view.rgb[:] = np.random.default_rng(0).integers(0, 255, view.rgb.shape)
    nothing = BackLayer(np.zeros(view.box.shape, bool), view.depth_m, view.rgb)
    part = view_gaussians(view, np.zeros(view.box.shape, bool), [nothing], GroundPlane(), SplatRadii())
    pixels, depth_m = view.camera.project(part.seen.centre_m.astype(np.float64))
    np.testing.assert_allclose(depth_m, 8.0, atol=1e-5)
    v, u = np.divmod(part.pixel, view.camera.width_px)
    np.testing.assert_allclose(pixels, np.stack([u, v], 1) + 0.5, atol=1e-3)
    np.testing.assert_array_equal(part.seen.rgb, view.rgb[v, u])
    np.testing.assert_array_equal(np.sort(part.pixel), np.arange(view.depth_m.size))
    assert len({(a // 16, b // 16) for a, b in zip(v[:256], u[:256], strict=True)}) == 1
    assert not len(part.behind)


def test_tiles_follow_each_other() -> None:
    order = tile_order(20, 40)
    tiles = (order // 40 // 16) * 3 + order % 40 // 16
    assert (np.diff(tiles) >= 0).all()
    np.testing.assert_array_equal(np.sort(order), np.arange(800))


def test_radii_of_the_paper() -> None:
    paper, heights = SplatRadii.paper(), np.array([-1.0, 0, 5, 10, 30])
    np.testing.assert_allclose(paper.background_m(heights), [0.02, 0.02, 0.0105, 0.001, 0.001])
    np.testing.assert_allclose(SplatRadii.released().background_m(np.array([0, 2.5, 5, 10])), [0.02, 0.0105, 0.001, 0.001])
    std, pixel = np.array([0.02, 0.001]), np.array([0.01, 0.01])
    assert paper.bounded(std, pixel).tolist() == [0.02, 0.001]
    np.testing.assert_allclose(SplatRadii(least_px=0.4, most_px=0.5).bounded(std, pixel), [0.005, 0.004])
    with pytest.raises(ValueError, match="positive"):
        SplatRadii(hidden_m=0.0)
    with pytest.raises(ValueError, match="ceiling"):
        SplatRadii(least_px=2.0)
    points = np.zeros((2, 3))
    assert blind_gaussians(points, np.zeros((2, 3), np.uint8), 0.04, SplatRadii()).std_m.tolist() == pytest.approx([0.04, 0.04])


def test_objects_sky_and_mixed_pixels() -> None:
    view = flat_view(10.0)
    view.box[10:20, 10:20] = 0
    view.depth_m[10:20, 10:20] = 5.0
    view.source[:4] = FROM_SKY
    hidden = BackLayer(view.box == 0, np.full(view.box.shape, 10.0, np.float32), view.rgb // 2)
    radii = SplatRadii(least_px=0.0, most_px=np.inf)
    part = view_gaussians(view, np.zeros(view.box.shape, bool), [hidden], GroundPlane(), radii)
    assert len(part.seen) == view.box.size - 40, "the ring around the object is left out"
    assert len(part.behind) == 100 + 40, "and known without it"
    v, u = np.divmod(part.pixel, view.camera.width_px)
    np.testing.assert_allclose(part.seen.std_m[view.box[v, u] == 0], 0.0025)
    np.testing.assert_allclose(part.seen.std_m[view.source[v, u] == FROM_SKY], radii.sky_px * 10 / 60, rtol=1e-5)


def test_sharpening_brings_renderings_closer_to_the_image() -> None:
    view = flat_view(8.0)
    view.rgb[:] = np.where((np.indices(view.box.shape).sum(0) // 4 % 2 == 0)[..., None], 60, 190)
    nothing = BackLayer(np.zeros(view.box.shape, bool), view.depth_m, view.rgb)
    part = view_gaussians(view, np.zeros(view.box.shape, bool), [nothing], GroundPlane(), SplatRadii())

    def error(gaussians: Gaussians) -> float:
        return float(np.square(render(gaussians, [view.camera])[0].rgb.astype(float) - view.rgb).mean())

    assert error(sharpened(part.seen, [part], [view], 1)) < 0.6 * error(part.seen)
    np.testing.assert_array_equal(sharpened(part.seen, [part], [view], 0).rgb, part.seen.rgb)


def test_a_rig_that_looks_up_has_no_blind_area() -> None:
    up = camera(pitch_rad=-1.2)
    frame = frame_with(Boxes3D.empty(), Pose.identity(), up)
    points = blind_points(Rig({"eye": up}), GroundPlane(), FrameSurfaces(RayCaster(GROUND), {}, frame), 0.2)
    assert np.isfinite(points).all()
    assert (np.linalg.norm(points[:, :2], axis=1) <= 13).all()
