"""A cube, a street and a camera for the tests of the scene steps."""

import numpy as np

from coin3d.datasets.frame import Frame
from coin3d.geometry import Boxes3D, Camera, Pose, Rig, camera_pose
from coin3d.geometry.mesh import TriangleMesh
from small_world import MemoryLidar

CUBE = TriangleMesh.create(
    np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2,
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ],
)  # fmt: skip
GROUND = TriangleMesh.create([[-200, -200, 0], [200, -200, 0], [200, 200, 0], [-200, 200, 0]], [[0, 1, 2], [0, 2, 3]])


def camera(pitch_rad: float = 0.0, yaw_rad: float = 0.0, width: int = 80, height: int = 48) -> Camera:
    K = np.array([[60.0, 0, width / 2 + 0.7], [0, 60.0, height / 2 - 1.3], [0, 0, 1]])
    return Camera(K, width, height, camera_pose([0.5, 0.2, 1.5], yaw_rad, pitch_rad))


def frame_with(boxes: Boxes3D, world_from_ego: Pose, cam: Camera, rgb: np.ndarray | None = None) -> Frame:
    image = np.full((cam.height_px, cam.width_px, 3), 90, np.uint8) if rgb is None else rgb
    rig = Rig({"eye": cam})
    return Frame("f", 0, rig, {"eye": image}, world_from_ego, boxes.transformed(world_from_ego), MemoryLidar(np.zeros((0, 3))))
