"""Named changes of a rig: the settings in which the paper's supplement shows novel views."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from coin3d.geometry.camera import Camera
from coin3d.geometry.pose import Pose, camera_pose
from coin3d.geometry.rig import Rig


def raised(rig: Rig, by_m: float) -> Rig:
    """Every camera moved up, away from the ground plane; down if negative.

    Raises:
        ValueError: a camera would sit at or below the ground.
    """
    up = by_m * rig.ground.normal
    cameras = {name: c.moved(Pose(c.ego_from_cam.rotation, c.ego_from_cam.translation + up)) for name, c in rig.items()}
    return replace(rig, cameras=cameras, name=f"{rig.name} {by_m:+g} m")


def full_overlap(rig: Rig, fov_deg: float = 120.0, spacing_deg: float = 60.0) -> Rig:
    """A ring of equal cameras, each seeing half of what its neighbours see ("full overlap", paper supplement).

    The ring has the image size of the rig's first camera, stands at the mean of the rig's cameras and looks out level.

    Args:
        rig: whose place, height and image size are taken.
        fov_deg: horizontal field of view of every camera.
        spacing_deg: yaw from one camera to the next; divides 360.

    Raises:
        ValueError: a field of view outside (0, 180), or a spacing that does not divide 360.
    """
    count = round(360 / spacing_deg) if spacing_deg > 0 else 0
    if not 0 < fov_deg < 180 or count < 1 or abs(count * spacing_deg - 360) > 1e-6:
        raise ValueError(
            f"a ring needs a field of view in (0, 180) and a spacing that divides 360, got {fov_deg}, {spacing_deg}"
        )
    first = next(iter(rig.values()))
    width, height = first.width_px, first.height_px
    focal_px = width / 2 / np.tan(np.deg2rad(fov_deg) / 2)
    K = np.array([[focal_px, 0, width / 2], [0, focal_px, height / 2], [0, 0, 1.0]])
    place = np.mean([c.ego_from_cam.translation for c in rig.values()], axis=0)
    yaws = np.deg2rad(spacing_deg) * np.arange(count)
    cameras = {f"RING_{np.rad2deg(yaw):.0f}": Camera(K, width, height, camera_pose(place, float(yaw))) for yaw in yaws}
    return replace(rig, cameras=cameras, name=f"{rig.name} full overlap")
