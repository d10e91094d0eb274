"""Cameras and LiDAR agree with the geometry they look at."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from coin3d.geometry import MIN_DEPTH_M, Rig
from coin3d.town import Moment, SpinningLidar, Tracer, World, render_camera


@pytest.fixture(scope="module")
def views(moment: Moment, rig: Rig):
    return {name: render_camera(moment, camera) for name, camera in rig.items()}


def test_depth_of_the_ground_is_that_of_a_plane(views, rig: Rig) -> None:
    agreeing = total = 0
    for name, camera in rig.items():
        rays = camera.rays_ego(camera.pixel_grid())
        with np.errstate(divide="ignore"):
            # pinhole rays have z = 1 in the camera, so the factor that reaches z = 0 is the depth
            expected = -camera.height_m / rays[..., 2]
        below = (rays[..., 2] < 0) & (expected < 25)
        depth = views[name].depth_m[below]
        total += depth.size
        agreeing += int((np.abs(depth - expected[below]) < 0.01).sum())
        assert (depth <= expected[below] + 0.01).all(), "nothing is farther than the ground behind it"
    assert agreeing > 0.4 * total


def test_sky_has_no_depth(views) -> None:
    sky = views["CAM_FRONT"].depth_m == 0
    assert sky[:20].mean() > 0.1 and not sky[-20:].any()


def test_boxes_contain_their_pixels(moment: Moment, views, rig: Rig) -> None:
    world = moment.world
    boxes = world.boxes(moment.time_s).transformed(world.world_from_ego(moment.time_s).inverse())
    found = 0
    for name, camera in rig.items():
        for i in range(len(boxes)):
            mask = views[name].actor == world.number_of[str(boxes.instance_ids[i])]
            if mask.sum() < 4:
                continue
            v, u = np.nonzero(mask)
            points = camera.ego_from_cam.apply(camera.rays_cam(np.stack([u, v], -1) + 0.5) * views[name].depth_m[mask][:, None])
            grown = boxes[i : i + 1]
            local = points - grown.centre_m[0]
            c, s = np.cos(grown.yaw_rad[0]), np.sin(grown.yaw_rad[0])
            along, across = c * local[:, 0] + s * local[:, 1], -s * local[:, 0] + c * local[:, 1]
            half = grown.size_m[0] / 2 + 0.03
            assert (
                (np.abs(along) < half[0]).all() and (np.abs(across) < half[1]).all() and (np.abs(local[:, 2]) < half[2]).all()
            )
            corners, depth = camera.project(grown.corners()[0])
            if (depth > MIN_DEPTH_M).all():
                hull = cv2.convexHull(corners.astype(np.float32))
                assert all(
                    cv2.pointPolygonTest(hull, (float(x) + 0.5, float(y) + 0.5), True) > -1.5 for x, y in zip(u, v, strict=True)
                )
            found += 1
    assert found >= 8


def test_lidar_points_lie_on_ground_or_boxes(moment: Moment) -> None:
    world = moment.world
    world_from_ego = world.world_from_ego(moment.time_s)
    lidar = SpinningLidar(noise_m=0.0)
    sweep = lidar.sweep(moment, world_from_ego, np.random.default_rng(0))
    assert sweep.dtype == np.float32 and sweep.shape[1] == 5 and len(sweep) > 15_000
    assert set(np.unique(sweep[:, 4])) <= set(range(32))
    points = (world_from_ego @ lidar.ego_from_lidar).apply(sweep[:, :3])
    assert points[:, 2].min() > -0.01
    lowest = sweep[:, 4] < 6
    assert (np.abs(points[lowest, 2]) < 0.02).mean() > 0.5
    boxes = world.boxes(moment.time_s)
    near = np.linalg.norm(boxes.centre_m[:, :2] - world_from_ego.translation[:2], axis=1) < 25
    assert (boxes[near].count_points(points) > 0).sum() >= 5


def test_lidar_axes_are_right_forward_up() -> None:
    mount = SpinningLidar().ego_from_lidar
    np.testing.assert_allclose(mount.rotate(np.array([[0.0, 1, 0], [1.0, 0, 0]])), [[1, 0, 0], [0, -1, 0]], atol=1e-12)


def test_hilly_lidar_ground_is_the_terrain(hilly: World) -> None:
    moment = Tracer(hilly).at(0.0)
    pose = hilly.world_from_ego(0.0)
    lidar = SpinningLidar(noise_m=0.0)
    sweep = lidar.sweep(moment, pose, np.random.default_rng(0))
    points = (pose @ lidar.ego_from_lidar).apply(sweep[:, :3])[sweep[:, 4] < 6]
    height = points[:, 2] - hilly.terrain.height_m(points[:, :2])
    assert (np.abs(height) < 0.03).mean() > 0.5


def test_misses_are_not_far_hits(moment: Moment) -> None:
    hits = moment.cast(np.array([[0, 0, 50.0]]), np.array([[0, 0, 1.0]]))
    assert hits.face[0] == -1 and np.isinf(hits.distance[0])


def test_image_noise_does_not_depend_on_who_asks_first(moment: Moment, rig: Rig, views) -> None:
    again = render_camera(moment, rig["CAM_BACK"])
    np.testing.assert_array_equal(again.image, views["CAM_BACK"].image)
