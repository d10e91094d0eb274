"""Poses, cameras, rigs, boxes: pure numpy, no files, no learning. Conventions: docs/conventions.md."""

from coin3d.geometry.boxes import VISIBILITY_PERCENT, Boxes3D, wrap_angle
from coin3d.geometry.camera import MIN_DEPTH_M, Camera
from coin3d.geometry.ground import GroundPlane
from coin3d.geometry.image_transform import ImageTransform, fit_width
from coin3d.geometry.lens import Lens, Pinhole
from coin3d.geometry.lens_brown_conrady import BrownConrady
from coin3d.geometry.lens_fisheye import Fisheye
from coin3d.geometry.pose import Pose, camera_pose
from coin3d.geometry.rig import Rig
from coin3d.geometry.rig_file import load_rig, save_rig
from coin3d.geometry.rig_presets import RIG_PRESETS, preset_rig

__all__ = [
    "MIN_DEPTH_M",
    "RIG_PRESETS",
    "VISIBILITY_PERCENT",
    "Boxes3D",
    "BrownConrady",
    "Camera",
    "Fisheye",
    "GroundPlane",
    "ImageTransform",
    "Lens",
    "Pinhole",
    "Pose",
    "Rig",
    "camera_pose",
    "fit_width",
    "load_rig",
    "preset_rig",
    "save_rig",
    "wrap_angle",
]
