"""What can be said about a rig in numbers, and about two rigs in differences."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from coin3d.geometry import Camera, GroundPlane, Rig, fit_width, wrap_angle
from coin3d.priors import PriorOptions

INPUT_WIDTH_PX = 704
"""Focal lengths are compared at this image width, the paper's network input: what counts is pixels per radian there."""
GROWTH_AT_M = 20.0
_COVERAGE_RANGE_M = 50.0
_COVERAGE_STEP_DEG = 0.25


@dataclass(frozen=True)
class CameraFacts:
    """One row of the table. Angles in degrees; pitch positive looks down, roll positive tilts right.

    Args:
        name: the camera.
        size_px: width and height of the image.
        focal_px: focal length in the image as recorded.
        input_focal_px: focal length after resizing to ``INPUT_WIDTH_PX``.
        inverse_focal: value of the inverse focal map there (paper eq. M_invF).
        fov_deg: horizontal and vertical field of view (paper eq. fov_calc).
        yaw_deg: direction of view, 0 forward, 90 left.
        pitch_deg: below the horizon.
        roll_deg: about the line of sight.
        height_m: above the ground plane.
        position_m: in the ego frame.
        nearest_ground_m: depth of the ground at the middle of the last image row, ``None`` if that row sees none.
        growth_m_per_row: how much deeper the ground is one row higher where it is ``GROWTH_AT_M`` deep, at network input.
    """

    name: str
    size_px: tuple[int, int]
    focal_px: float
    input_focal_px: float
    inverse_focal: float
    fov_deg: tuple[float, float]
    yaw_deg: float
    pitch_deg: float
    roll_deg: float
    height_m: float
    position_m: tuple[float, float, float]
    nearest_ground_m: float | None
    growth_m_per_row: float | None


@dataclass(frozen=True)
class RigFacts:
    """A rig in numbers; coverage is of directions around the vehicle, 1 m above ground 50 m away."""

    name: str
    cameras: tuple[CameraFacts, ...]
    covered_deg: float
    overlapping_deg: float


@dataclass(frozen=True)
class CameraPair:
    """A camera of one rig and the camera of the other that looks most nearly the same way."""

    camera: str
    other: str
    yaw_change_deg: float
    pitch_change_deg: float
    input_focal_ratio: float
    height_change_m: float


@dataclass(frozen=True)
class RigDifference:
    """What changes from one rig to another; pairs run over the cameras of the other rig."""

    camera_count_change: int
    covered_change_deg: float
    overlapping_change_deg: float
    pairs: tuple[CameraPair, ...]


def rig_facts(rig: Rig) -> RigFacts:
    """All numbers of one rig."""
    count = seen_by(rig)
    return RigFacts(
        rig.name,
        tuple(_camera_facts(name, camera, rig.ground) for name, camera in rig.items()),
        float((count >= 1).mean() * 360),
        float((count >= 2).mean() * 360),
    )


def rig_difference(rig: RigFacts, other: RigFacts) -> RigDifference:
    """From ``rig`` to ``other``: differences are other minus rig, ratios other over rig."""
    pairs = []
    for camera in other.cameras:
        turns = [float(np.rad2deg(wrap_angle(np.deg2rad(camera.yaw_deg - c.yaw_deg)))) for c in rig.cameras]
        nearest = int(np.argmin(np.abs(turns)))
        partner = rig.cameras[nearest]
        pairs.append(
            CameraPair(
                partner.name,
                camera.name,
                turns[nearest],
                camera.pitch_deg - partner.pitch_deg,
                camera.input_focal_px / partner.input_focal_px,
                camera.height_m - partner.height_m,
            )
        )
    return RigDifference(
        len(other.cameras) - len(rig.cameras),
        other.covered_deg - rig.covered_deg,
        other.overlapping_deg - rig.overlapping_deg,
        tuple(pairs),
    )


def coverage_azimuths_rad() -> Float[np.ndarray, "n"]:
    """The directions ``seen_by`` looks in, from -180 to 180 degrees."""
    return np.asarray(np.deg2rad(np.arange(-180 + _COVERAGE_STEP_DEG / 2, 180, _COVERAGE_STEP_DEG)))


def seen_by(rig: Rig) -> Int[np.ndarray, "n"]:
    """How many cameras see a point 50 m away and 1 m above the ground, per direction around the vehicle."""
    azimuth = coverage_azimuths_rad()
    xy = _COVERAGE_RANGE_M * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    ground_z = -(xy @ rig.ground.normal[:2] + rig.ground.offset_m) / rig.ground.normal[2]
    points = np.concatenate([xy, ground_z[:, None] + 1.0], axis=1)
    return np.asarray(np.sum([camera.sees(points) for camera in rig.values()], axis=0))


def at_network_input(camera: Camera, width_px: int = INPUT_WIDTH_PX, height_px: int | None = None) -> Camera:
    """The camera after the paper's image rule; without ``height_px`` no row is cut or padded."""
    rows = round(camera.height_px * width_px / camera.width_px) if height_px is None else height_px
    return fit_width(camera, width_px, rows).camera(camera)


def ground_profile(camera: Camera, ground: GroundPlane) -> tuple[float, float]:
    """Inverse ground depth down the middle column, in 1/m: its value at row 0 (top edge) and its change per row."""
    height_m = float(ground.height_m(camera.ego_from_cam.translation))
    slope = -(ground.normal @ camera.ego_from_cam.rotation @ np.linalg.inv(camera.K)) / height_m
    return float(slope @ [camera.width_px / 2, 0, 1]), float(slope[1])


def _camera_facts(name: str, camera: Camera, ground: GroundPlane) -> CameraFacts:
    small = at_network_input(camera)
    at_top, per_row = ground_profile(small, ground)
    at_bottom = at_top + per_row * (small.height_px - 0.5)
    at_growth = 1 / GROWTH_AT_M
    right, down, forward = camera.ego_from_cam.rotation.T
    reference_px = PriorOptions().focal_for_width_px(INPUT_WIDTH_PX)
    x, y, z = camera.ego_from_cam.translation.tolist()
    return CameraFacts(
        name,
        (camera.width_px, camera.height_px),
        camera.focal_px,
        small.focal_px,
        (reference_px / small.focal_px) ** 2,
        (float(np.rad2deg(camera.fov_horizontal_rad)), float(np.rad2deg(camera.fov_vertical_rad))),
        float(np.rad2deg(camera.yaw_rad)),
        float(np.rad2deg(-np.arcsin(np.clip(forward[2], -1, 1)))),
        float(np.rad2deg(np.arctan2(-right[2], -down[2]))),
        float(ground.height_m(camera.ego_from_cam.translation)),
        (x, y, z),
        1 / at_bottom if at_bottom > 0 else None,
        per_row / (at_growth * (at_growth - per_row)) if 0 < per_row < at_growth else None,
    )
