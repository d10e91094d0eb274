"""Rigs from other tools' calibration files: Kalibr, ROS, COLMAP. Every reader gives cameras in one *base* frame of its own.

Where that base sits on the vehicle only the user knows; ``import_rig`` puts the two together.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from coin3d.geometry import Pose, Rig
from coin3d.rig_import.base import Base, Imported
from coin3d.rig_import.colmap import is_colmap, read_colmap
from coin3d.rig_import.kalibr import is_kalibr, read_kalibr
from coin3d.rig_import.ros import CameraAxes, read_ros

Format = Literal["auto", "kalibr", "ros", "colmap"]

__all__ = ["Base", "CameraAxes", "Format", "Imported", "import_rig"]


def import_rig(
    source: Path,
    base: Base,
    *,
    format: Format = "auto",
    scale: float | None = None,
    camera_axes: CameraAxes = "auto",
    rectified: bool = False,
) -> tuple[Rig, tuple[str, ...]]:
    """Read a calibration.

    Args:
        source: Kalibr's camchain YAML; a folder (or one file) of ROS CameraInfo and tf dumps in YAML; or a COLMAP text model.
        base: which frame the pose is known of, and the pose.
        format: of the source; by default it is recognised.
        scale: COLMAP only: metres per unit of the reconstruction.
        camera_axes: ROS only: what the frames of CameraInfo mean.
        rectified: ROS only: calibration of the rectified images (matrix P) instead of the raw ones.

    Returns:
        the rig and remarks for the user.

    Raises:
        FileNotFoundError: no such source.
        ValueError: the source is damaged or contradicts itself, holds a camera model that is not supported, or the pose of its
            base is missing.
    """
    source = Path(source)
    if not source.exists():
        raise FileNotFoundError(f"{source}: no such file or folder to import a rig from")
    if format == "auto":
        format = "colmap" if is_colmap(source) else "kalibr" if is_kalibr(source) else "ros"
    if scale is not None and format != "colmap":
        raise ValueError(f"--scale is for COLMAP models; {source} is read as {format}, which is in metres")
    if (camera_axes != "auto" or rectified) and format != "ros":
        raise ValueError(f"--camera-axes and --rectified are for ROS; {source} is read as {format}")
    if format == "colmap":
        imported = read_colmap(source, base.name, scale)
    elif format == "kalibr":
        imported = read_kalibr(source, base.name)
    else:
        imported = read_ros(
            source, base.name, base.ego_from_base(camera=False, required=False), camera_axes, rectified=rectified
        )
    ego_from_base = base.ego_from_base(camera=imported.base_is_camera, required=imported.base_pose_required, name=imported.base)
    cameras = {name: c.moved(ego_from_base @ c.ego_from_cam) for name, c in imported.cameras.items()}
    # results can then be given in the user's own frame, if it is one of the vehicle
    own = Pose.identity() if imported.base_is_camera else ego_from_base
    try:
        return Rig(cameras, ego_from_vehicle=own, name=source.resolve().stem), imported.remarks
    except ValueError as error:
        raise ValueError(f"{source}: {error}; --base-pose says where '{imported.base}' is on the vehicle") from error
