"""A few seconds of the town as a LiDAR and an annotator see it, held in memory, and the true bodies for whoever scores."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from coin3d.datasets.frame import Frame, LidarScan
from coin3d.geometry import Pose
from coin3d.town import SpinningLidar, Tracer, World
from coin3d.town.mesh import Mesh
from small_world import ring_rig

KEY_S, PARTS = 0.5, 5


@dataclass(frozen=True)
class Scan:
    scan: LidarScan

    def load(self) -> LidarScan:
        return self.scan


@dataclass(frozen=True)
class TownSweeps:
    frames: list[Frame]
    between: dict[str, list[tuple[int, Scan]]]

    def sweeps(self, frame: Frame) -> list[tuple[int, Scan]]:
        return self.between[frame.token]


def drive(world: World, key_frames: int, seed: int = 0) -> TownSweeps:
    """Key frames at 2 Hz, sweeps at 10 Hz."""
    tracer, lidar, rig = Tracer(world), SpinningLidar(), ring_rig(1)
    images = {name: np.zeros((c.height_px, c.width_px, 3), dtype=np.uint8) for name, c in rig.items()}

    def scan(step: int, world_from_ego_ref: Pose) -> tuple[int, Scan]:
        time_s = step * KEY_S / PARTS
        world_from_ego = world.world_from_ego(time_s)
        records = lidar.sweep(tracer.at(time_s), world_from_ego, np.random.default_rng([seed, step]))
        ref_from_lidar = world_from_ego_ref.inverse() @ world_from_ego @ lidar.ego_from_lidar
        points = ref_from_lidar.apply(records[:, :3].astype(np.float64))
        return round(time_s * 1e9), Scan(LidarScan(points, records[:, 3].astype(np.float64), ref_from_lidar.translation))

    frames, between = [], {}
    for k in range(key_frames):
        world_from_ego = world.world_from_ego(k * KEY_S)
        time_ns, source = scan(PARTS * k, world_from_ego)
        boxes = world.boxes(k * KEY_S)
        near = np.linalg.norm(boxes.centre_m[:, :2] - world_from_ego.translation[:2], axis=1) < 60
        frames.append(Frame(f"key{k}", time_ns, rig, images, world_from_ego, boxes[near], source, "town"))
        last = k == key_frames - 1
        between[f"key{k}"] = [] if last else [scan(PARTS * k + i, world_from_ego) for i in range(1, PARTS)]
    return TownSweeps(frames, between)


def sampled(vertices: np.ndarray, faces: np.ndarray, step_m: float) -> np.ndarray:
    """Points all over the triangles, about ``step_m`` apart."""
    rng = np.random.default_rng(0)
    corner = vertices[faces].astype(np.float64)
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1) / 2
    of = np.repeat(np.arange(len(faces)), np.ceil(2 * area / step_m**2).astype(int) + 1)
    share = rng.random((len(of), 2))
    share = np.where((share.sum(1) > 1)[:, None], 1 - share, share)
    a, b, c = np.moveaxis(corner[of], 1, 0)
    return a + share[:, :1] * (b - a) + share[:, 1:] * (c - a)


def body_volume_m3(body: Mesh, cell_m: float = 0.04) -> float:
    """What a body displaces: its parts overlap, so cells that cannot be reached from outside are counted."""
    points = sampled(body.vertices, body.faces, 0.4 * cell_m)
    index = np.floor((points - points.min(0)) / cell_m).astype(int) + 1
    skin = np.zeros(index.max(0) + 2, dtype=bool)
    skin[tuple(index.T)] = True
    return float((ndimage.binary_fill_holes(skin).sum() - 0.5 * skin.sum()) * cell_m**3)
