"""Findings about a rig alone: mixed-up transforms, implausible mounts and intrinsics, cameras that see no ground."""

from __future__ import annotations

import numpy as np

from coin3d.check.finding import Finding
from coin3d.geometry import Camera, GroundPlane, Pose, Rig, camera_pose
from coin3d.geometry.rig import is_plausible_mount

_GROUND_RANGE_M = 60.0
_MAX_CENTRE_OFFSET = 0.2  # of the image side
_FOV_DEG = (10.0, 175.0)
_QUATERNION = "the quaternion has the order x, y, z, w instead of w, x, y, z"


def rig_findings(rig: Rig) -> list[Finding]:
    """Everything suspicious about the cameras of a rig."""
    findings: list[Finding] = []
    for name, camera in rig.items():
        findings += _mount(name, camera, rig.ground)
        findings += _intrinsics(name, camera)
        if not _sees_ground(camera, rig.ground):
            findings.append(
                Finding(
                    "warning",
                    f"no pixel sees the ground within {_GROUND_RANGE_M:.0f} m",
                    "ground priors are empty for this camera; check its pitch, its height and the rig's ground",
                    name,
                    "cameras",
                )
            )
    return findings


def _mount(name: str, camera: Camera, ground: GroundPlane) -> list[Finding]:
    pose = camera.ego_from_cam
    if is_plausible_mount(pose, ground):
        return []
    elevation_deg = float(np.rad2deg(np.arcsin(np.clip(pose.rotation[:, 2] @ ground.normal, -1, 1))))
    down_deg = float(np.rad2deg(np.arccos(np.clip(-pose.rotation[:, 1] @ ground.normal, -1, 1))))
    height_m = float(ground.height_m(pose.translation))
    facts = f"it sits {height_m:.2f} m above ground, looks {elevation_deg:+.0f} deg up, its image is turned {down_deg:.0f} deg"
    meant = [reading for reading, fixed in _mixed_up(pose).items() if is_plausible_mount(fixed, ground)]
    if meant and meant != [_QUATERNION]:  # by which a camera that looks straight down would look ahead
        text = f"the transform is mixed up: {' or '.join(meant)} ({facts})"
        return [Finding("error", text, "docs/your_rig.md says what is expected", name, "cameras")]
    if abs(elevation_deg) > 45 or down_deg > 45:
        hint = f"it would fit if {_QUATERNION}; " if meant else ""
        return [
            Finding(
                "warning",
                f"it faces up or down, or lies on its side: {facts}",
                f"a mixed-up transform is likely: {hint}compare rotation and axes with docs/your_rig.md",
                name,
                "cameras",
            )
        ]
    return [
        Finding(
            "warning",
            f"an unusual height: {facts}",
            "positions are metres in the ego frame, from the ground up",
            name,
            "cameras",
        )
    ]


def _mixed_up(pose: Pose) -> dict[str, Pose]:
    """What people store instead of ``ego_from_cam`` -> the pose they meant, if they did."""
    w, x, y, z = pose.quaternion
    return {
        "cam_from_ego is stored for ego_from_cam, invert it": pose.inverse(),
        "its axes are x forward, y left, z up instead of x right, y down, z forward": Pose(
            pose.rotation @ camera_pose(np.zeros(3)).rotation, pose.translation
        ),
        _QUATERNION: Pose.from_quaternion([z, w, x, y], pose.translation),
    }


def _intrinsics(name: str, camera: Camera) -> list[Finding]:
    findings = []
    # rows are often cropped away above or below, columns hardly ever
    aside = abs(camera.K[0, 2] / camera.width_px - 0.5) > _MAX_CENTRE_OFFSET
    if aside or not 0 < camera.K[1, 2] < camera.height_px:
        findings.append(
            Finding(
                "warning",
                f"the principal point ({camera.K[0, 2]:.0f}, {camera.K[1, 2]:.0f}) is far from the centre of a "
                f"{camera.width_px} x {camera.height_px} image",
                "K may belong to another image size: scale row 1 with the width, row 2 with the height; fine after a crop",
                name,
                "cameras",
            )
        )
    left, right = camera.rays_cam(np.array([[0.0, camera.K[1, 2]], [camera.width_px, camera.K[1, 2]]]))
    cosine = left @ right / np.linalg.norm(left) / np.linalg.norm(right)
    fov_deg = float(np.rad2deg(np.arccos(np.clip(cosine, -1, 1))))
    if fov_deg <= _FOV_DEG[0] or fov_deg >= _FOV_DEG[1]:  # not a number where a lens model ends before the image does
        findings.append(
            Finding(
                "warning",
                f"a horizontal field of view of {fov_deg:.1f} deg",
                "check the focal length (pixels)",
                name,
                "cameras",
            )
        )
    return findings


def _sees_ground(camera: Camera, ground: GroundPlane) -> bool:
    u, v = np.meshgrid(np.linspace(0.5, camera.width_px - 0.5, 12), np.linspace(0.5, camera.height_px - 0.5, 24))
    rays = camera.rays_ego(np.stack([u, v], axis=-1).reshape(-1, 2))
    height_m = ground.height_m(camera.ego_from_cam.translation)
    sink = -(rays @ ground.normal)
    with np.errstate(divide="ignore"):
        range_m = np.linalg.norm(rays, axis=1) * height_m / np.where(sink > 0, sink, np.nan)
    return bool((range_m < _GROUND_RANGE_M).any())
