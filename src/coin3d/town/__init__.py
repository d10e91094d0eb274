"""The town: a procedural street world that any rig can record, written to disk in nuScenes format."""

from coin3d.town.camera_image import View, render_camera
from coin3d.town.lidar import SpinningLidar
from coin3d.town.options import TownOptions
from coin3d.town.raycast import Moment, Tracer
from coin3d.town.record import record
from coin3d.town.world import World, build_world

__all__ = ["Moment", "SpinningLidar", "TownOptions", "Tracer", "View", "World", "build_world", "record", "render_camera"]
