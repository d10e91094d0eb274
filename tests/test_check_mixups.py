"""What ``coin3d check`` reads out of LiDAR points, images and drives: each mix-up is named, sound recordings are left alone."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest

from coin3d.check.box_readings import box_findings
from coin3d.check.frame_checks import FrameReport, inspect_frame
from coin3d.check.image_alignment import Alignment, depth_edges, edge_brightness, image_findings
from coin3d.check.inspection import inspect
from coin3d.check.lidar_counts import count_findings
from coin3d.check.motion_checks import heading_findings, pose_findings
from coin3d.check.rig_checks import rig_findings
from coin3d.check.sweep_overlap import sweep_findings
from coin3d.datasets.frame import Frame, LidarScan
from coin3d.geometry import Boxes3D, Camera, Pose, Rig, camera_pose

WIDTH, HEIGHT = 240, 120
POLES_DEG = {"front": (-31, -22, -9, -3, 6, 17, 29), "left": (-28, -17, -12, 1, 9, 20, 33)}
YAW_DEG = {"front": 0.0, "left": 90.0}


@dataclass(frozen=True)
class Held:
    """A sweep in memory."""

    points_ego: np.ndarray

    def load(self) -> LidarScan:
        return LidarScan(self.points_ego, np.zeros(len(self.points_ego)), np.array([0.0, 0.0, 1.8]))


def camera(yaw_deg: float) -> Camera:
    """70 degrees wide, 1.5 m high."""
    focal = WIDTH / 2 / np.tan(np.deg2rad(35))
    return Camera(
        np.array([[focal, 0, WIDTH / 2], [0, focal, HEIGHT / 2], [0, 0, 1]]), WIDTH, HEIGHT,
        camera_pose([0, 0, 1.5], np.deg2rad(yaw_deg)),
    )  # fmt: skip


def distance_m(direction_deg: np.ndarray, poles_deg: tuple[int, ...]) -> np.ndarray:
    """A round wall 25 m away, and poles of two degrees 9 m away."""
    on_pole = (np.abs(direction_deg[..., None] - np.array(poles_deg)) < 1.0).any(-1)
    return np.where(on_pole, 9.0, 25.0)


def poles_frame(token: str = "0", shift_deg: float = 0.0) -> Frame:
    """A frame before a wall with poles; ``shift_deg`` turns what there is to see."""
    rig = Rig({name: camera(yaw) for name, yaw in YAW_DEG.items()})
    noise = np.random.default_rng(0)
    images, points = {}, []
    for name, entry in rig.items():
        poles = tuple(p + shift_deg for p in POLES_DEG[name])
        rays = entry.rays_cam(entry.pixel_grid())
        far = distance_m(-np.rad2deg(np.arctan2(rays[..., 0], rays[..., 2])), poles)
        grey = np.where(far < 20, 60, 150) + noise.normal(0, 12, far.shape)
        images[name] = np.repeat(grey.clip(0, 255).astype(np.uint8)[..., None], 3, axis=2)
        direction = np.arange(-36, 36, 0.3)
        reach = distance_m(direction, poles)
        heading = np.deg2rad(direction + YAW_DEG[name])
        for height in np.arange(-2.0, 2.5, 0.25):  # of the beams, 10 m away
            points.append(np.stack([reach * np.cos(heading), reach * np.sin(heading), 1.5 + height * reach / 10], axis=1))
    return Frame(token, 0, rig, images, lidar=Held(np.concatenate(points)))


def reported(frame: Frame) -> FrameReport:
    report = inspect_frame(frame)
    assert report.scan is not None
    return report


def test_edges_of_depth_are_where_the_poles_are() -> None:
    frame = poles_frame()
    edges = depth_edges(reported(frame).scan.points_ego, frame.rig["front"])
    assert edges.shape == (60, 119)
    columns = np.flatnonzero(edges.any(0)) + 1  # edges lie between cells
    focal = frame.rig["front"].focal_px / 2
    sides = [60 - focal * np.tan(np.deg2rad(p + side)) for p in POLES_DEG["front"] for side in (-1, 1)]
    assert all(min(abs(c - s) for s in sides) < 1.6 for c in columns)
    assert all(min(abs(c - s) for c in columns) < 1.6 for s in sides)
    brightness = edge_brightness(frame.images["front"])
    assert brightness.shape == edges.shape and brightness[edges].mean() > 1.5 * brightness.mean()


def test_images_that_fit_are_left_alone_and_clearly_so() -> None:
    report = reported(poles_frame())
    assert image_findings([report], {}) == []
    alignment = Alignment.none()
    alignment.add(
        depth_edges(report.scan.points_ego, report.frame.rig["left"]), edge_brightness(report.images["left"])
    )  # fmt: skip
    assert alignment.score > 4.5


def test_swapped_images_are_named() -> None:
    frame = poles_frame()
    swapped = replace(frame, images={"front": frame.images["left"], "left": frame.images["front"]})
    found = image_findings([reported(swapped)], {})
    assert [(f.where, f.about, f.severity) for f in found] == [("front", "images", "error"), ("left", "images", "error")]
    assert "the one of left does" in found[0].text


def test_mirrored_images_and_those_of_the_next_frame_are_named() -> None:
    frame = poles_frame()
    mirrored = replace(frame, images={name: image[:, ::-1].copy() for name, image in frame.images.items()})
    assert {"the one mirrored does" in f.text for f in image_findings([reported(mirrored)], {})} == {True}
    later = poles_frame("1", shift_deg=5.0)
    late = replace(frame, images=later.images)
    around = {"0": {"after": replace(later, images=frame.images)}}  # the images of this frame lie with the next
    found = image_findings([reported(late)], around)
    assert found and all("the one of the frame after does" in f.text for f in found)


def test_a_turned_camera_is_off_by_so_much() -> None:
    frame = poles_frame()
    turned = Rig({**frame.rig.cameras, "front": camera(3.0)})
    (finding,) = image_findings([reported(replace(frame, rig=turned))], {})
    assert (finding.where, finding.about) == ("front", "cameras")
    # three degrees to the left: for it, what LiDAR saw lies further right than it lies in the image
    share = np.tan(np.deg2rad(3.0)) * frame.rig["front"].focal_px / WIDTH
    told = re.search(r"([\d.]+)% of the image's width further left", finding.text)
    assert told is not None and abs(float(told[1]) / 100 - share) < 1.5 / 120  # cells


def cars() -> Boxes3D:
    places = [(10, 4), (14, -6), (-9, 5), (3, -9), (20, 10), (-15, -4)]
    yaws = np.deg2rad([20, 70, -50, 35, 110, -25])
    return Boxes3D.create(
        [(x, y, 0.8) for x, y in places], [(4.6, 1.9, 1.6)] * 6, yaws, ["vehicle.car"] * 6,
        instance_ids=[f"car {i}" for i in range(6)],
    )  # fmt: skip


def on_sides(boxes: Boxes3D) -> np.ndarray:
    """Points just inside the four sides of boxes."""
    along = np.linspace(-0.49, 0.49, 6)
    outline = np.concatenate([[(a, s), (s, a)] for a in along for s in (-0.48, 0.48)])
    points = []
    for box in range(len(boxes)):
        length, width, height = boxes.size_m[box]
        x, y = outline[:, 0] * length, outline[:, 1] * width
        c, s = np.cos(boxes.yaw_rad[box]), np.sin(boxes.yaw_rad[box])
        points += [np.stack([c * x - s * y, s * x + c * y, np.full_like(x, z * height)], 1) + boxes.centre_m[box]
                   for z in (-0.4, 0.0, 0.45)]  # fmt: skip
    return np.concatenate(points)


def frame_with(boxes: Boxes3D, points: np.ndarray, world_from_ego: Pose | None = None, token: str = "0") -> Frame:
    rig = Rig({"front": camera(0.0)})
    world_from_ego = world_from_ego or Pose.identity()
    images = {"front": np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)}
    return Frame(token, 0, rig, images, world_from_ego, boxes.transformed(world_from_ego), Held(points))


def test_right_boxes_have_no_better_reading() -> None:
    assert box_findings([reported(frame_with(cars(), on_sides(cars())))], {}) == []


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda b: replace(b, size_m=b.size_m[:, [1, 0, 2]]), "length and width swapped"),
        (lambda b: replace(b, yaw_rad=b.yaw_rad + np.pi / 2), "yaw counted from the y axis"),
        (lambda b: replace(b, yaw_rad=-b.yaw_rad), "the other sign of yaw"),
        (lambda b: replace(b, centre_m=b.centre_m - [0, 0, 0.8]), "centre is that of the bottom"),
        (lambda b: replace(b, centre_m=b.centre_m * [1, -1, 1], yaw_rad=-b.yaw_rad), "the other sign of y"),
        (lambda b: b.transformed(Pose.from_euler(np.pi / 2, 0, 0, np.zeros(3))), "quarter turn to the right of the LiDAR"),
    ],
)
def test_other_readings_are_named(change: Callable[[Boxes3D], Boxes3D], named: str) -> None:
    (finding,) = box_findings([reported(frame_with(change(cars()), on_sides(cars())))], {})
    assert named in finding.text and (finding.about, finding.severity) == ("boxes", "error")


def test_boxes_of_very_many_points_are_told_apart_as_well() -> None:
    """Either way each holds more points than are counted of one box: shares tell, capped counts would not."""
    swapped = replace(cars(), size_m=cars().size_m[:, [1, 0, 2]])
    inner = replace(cars(), size_m=cars().size_m * [0.3, 0.7, 1.0])
    shifted_m = np.linspace(-0.05, 0.05, 4)[:, None, None] * [0, 0, 1]
    points = np.concatenate([*(on_sides(cars()) + shifted_m), *(on_sides(inner) + shifted_m[::3])])
    assert min(swapped.count_points(points)) > 100
    (finding,) = box_findings([reported(frame_with(swapped, points))], {})
    assert "length and width swapped" in finding.text


def test_boxes_given_in_the_ego_frame_are_named() -> None:
    pose = Pose.from_euler(0.4, 0, 0, np.array([6.0, -11.0, 0.0]))
    frame = frame_with(cars(), on_sides(cars()), pose).with_boxes_world(cars())
    (finding,) = box_findings([reported(frame)], {})
    assert "in the ego frame, not in the world" in finding.text


def test_boxes_of_the_next_frame_are_named() -> None:
    drive = Pose(np.eye(3), np.array([2.5, 0.0, 0.0]))
    moved = cars().transformed(drive)
    frame = frame_with(moved, on_sides(cars()))
    (finding,) = box_findings([reported(frame)], {"0": {"before": frame_with(cars(), on_sides(cars()))}})
    assert "those of the frame before" in finding.text


@dataclass(frozen=True)
class Drive:
    """Frames of a drive past parked cars, five of them at 3 m."""

    pose: Callable[[int], Pose]

    def __len__(self) -> int:
        return 5

    def __getitem__(self, index: int) -> Frame:
        pose = self.pose(index)
        around = cars().transformed(pose.inverse())
        return replace(frame_with(around, on_sides(around), pose, str(index)), scene="drive")

    def __iter__(self) -> Iterator[Frame]:
        return (self[i] for i in range(5))


def ahead(index: int) -> Pose:
    return Pose.from_euler(2.0, 0, 0, 3.0 * index * np.array([np.cos(2.0), np.sin(2.0), 0.0]))


def test_poses_by_which_the_vehicle_drives_ahead_are_left_alone_and_inverted_ones_named() -> None:
    assert pose_findings(Drive(ahead)) == []
    (finding,) = pose_findings(Drive(lambda i: ahead(i).inverse()))
    assert finding.about == "poses" and "180 deg" not in finding.text
    (finding,) = pose_findings(Drive(lambda i: ahead(i) @ Pose.from_euler(np.pi, 0, 0, np.zeros(3))))
    assert "180 deg" in finding.text


def nearly_back(index: int) -> Pose:
    """Driving 20 degrees beside the -x axis of the world: inverted, these poses look ahead, too."""
    yaw = np.deg2rad(160.0)
    return Pose.from_euler(yaw, 0, 0, 3.0 * index * np.array([np.cos(yaw), np.sin(yaw), 0.0]))


@pytest.mark.parametrize("poses", [ahead, nearly_back])
def test_sweeps_lie_on_each_other_and_do_not_by_inverted_poses(poses: Callable[[int], Pose]) -> None:
    drive = Drive(poses)
    around = {"2": {"before": drive[1], "after": drive[3]}}
    assert sweep_findings([reported(drive[2])], around) == []
    inverted = {w: replace(f, world_from_ego=f.world_from_ego.inverse()) for w, f in around["2"].items()}
    now = replace(drive[2], world_from_ego=drive[2].world_from_ego.inverse())
    (finding,) = sweep_findings([reported(now)], {"2": inverted})
    assert "100% with the poses inverted (median of 2" in finding.text and finding.about == "poses"


def test_inverted_poses_are_named_where_moves_alone_do_not_tell() -> None:
    drive = Drive(lambda i: nearly_back(i).inverse())
    assert pose_findings(drive) == []
    held = [replace(Drive(nearly_back)[i], world_from_ego=nearly_back(i).inverse(), boxes_world=None) for i in range(5)]
    texts = [f.text for f in inspect(held, frames=3).findings if f.about == "poses"]  # type: ignore[arg-type]
    assert len(texts) == 1 and "100% with the poses inverted" in texts[0]


def test_poses_in_other_units_are_named_by_the_sweeps() -> None:
    frame = frame_with(cars(), on_sides(cars()))
    tenth = Pose(np.eye(3), np.array([300.0, 0.0, 0.0]))  # a vehicle that stands, by poses in centimetres
    (finding,) = sweep_findings([reported(frame)], {"0": {"after": replace(frame, world_from_ego=tenth)}})
    assert "0% of a sweep" in finding.text and "100% if the vehicle had not moved at all" in finding.text


@pytest.mark.parametrize(("standing", "findings"), [(2, 0), (0, 1)])
def test_traffic_that_drives_along_is_no_mistake_while_anything_stands(standing: int, findings: int) -> None:
    """Cars keep their places beside the vehicle, which drives 2.3 m; the first ``standing`` of six stay behind."""
    drive = Pose(np.eye(3), np.array([2.3, 0.7, 0.0]))
    here = cars()
    behind = here[:standing].transformed(drive.inverse())
    there = Boxes3D.concatenate([behind, here[standing:]])
    now, later = frame_with(here, on_sides(here)), frame_with(there, on_sides(there), drive)
    assert len(sweep_findings([reported(now)], {"0": {"after": later}})) == findings


def counted(found: list[int], annotated: list[int], token: str = "0") -> FrameReport:
    report = FrameReport(replace(frame_with(cars(), on_sides(cars())), token=token))
    report.found_points, report.annotated_points = np.array(found), np.array(annotated)
    return report


def test_counts_of_points_that_are_right_or_an_even_share_are_no_mistake() -> None:
    assert count_findings([counted([], []), counted([40, 0, 7], [40, 0, 7])]) == []
    # a fifth of the points each, to within 4 of 170
    (finding,) = count_findings([counted([100, 40], [500, 210]), counted([30, 0], [140, 1])])
    assert finding.severity == "note" and "4 of 4 boxes" in finding.text and "evenly 0.20 times" in finding.text


def test_counts_that_differ_unevenly_are_a_warning_that_names_the_worst_frame() -> None:
    (finding,) = count_findings([counted([90, 40], [100, 40], "near"), counted([200, 0, 3], [20, 200, 3], "far")])
    assert (finding.severity, finding.where) == ("warning", "far")
    assert finding.text == "3 of 5 boxes hold another number of LiDAR points than annotated (largest difference 200)"


def test_headings_across_the_way_are_named() -> None:
    here, there = cars(), replace(cars(), centre_m=cars().centre_m + 3 * np.stack(
        [np.cos(cars().yaw_rad), np.sin(cars().yaw_rad), np.zeros(6)], axis=1))  # fmt: skip
    around = {"0": {"after": frame_with(there, on_sides(there))}}
    assert heading_findings([reported(frame_with(here, on_sides(here)))], around) == []
    across = replace(here, yaw_rad=here.yaw_rad + np.pi / 2)
    (finding,) = heading_findings([reported(frame_with(across, on_sides(here)))], around)
    assert "90 deg" in finding.text


def test_quaternions_out_of_order_are_named_and_crops_are_no_mistake() -> None:
    entry = camera(120.0)
    w, x, y, z = entry.ego_from_cam.quaternion
    wrong = entry.moved(Pose.from_quaternion([x, y, z, w], entry.ego_from_cam.translation))
    assert "order x, y, z, w" in "\n".join(map(str, rig_findings(Rig({"front": wrong}))))
    cropped = replace(entry, K=entry.K - [[0, 0, 0], [0, 0, 45], [0, 0, 0]])
    assert rig_findings(Rig({"front": cropped})) == []
    doubled = replace(entry, K=np.diag([2.0, 2.0, 1.0]) @ entry.K)
    assert "principal point" in rig_findings(Rig({"front": doubled}))[0].text


def test_all_of_it_runs_on_a_recording_and_finds_it_sound() -> None:
    inspection = inspect(Drive(ahead), frames=3)
    assert len(inspection.reports) == 3
    assert {f.about for f in inspection.findings if f.severity == "error"} == set()
