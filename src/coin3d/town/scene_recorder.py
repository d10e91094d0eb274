"""One scene of a recording: drive through the town, take pictures and sweeps, note the boxes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from coin3d.geometry import Boxes3D, Pinhole, Pose, Rig
from coin3d.town.camera_image import View, render_camera
from coin3d.town.lidar import SpinningLidar
from coin3d.town.nuscenes_writer import (
    TABLES,
    Row,
    Rows,
    box_fields,
    chain,
    intrinsic_field,
    pose_fields,
    read_back,
    token,
    visibility_token,
)
from coin3d.town.options import TownOptions
from coin3d.town.plan import GroundPlan
from coin3d.town.raycast import Moment, Tracer
from coin3d.town.shading import ContactShade
from coin3d.town.visibility import visible_share
from coin3d.town.world import World, build_world

KEY_FRAME_S = 0.5
SWEEPS_PER_KEY_FRAME = 5
ANNOTATED_M = 80.0
JPEG_QUALITY = 95
DEPTH_UNIT_M = 0.01
_EPOCH_US = 1_600_000_000_000_000


@dataclass(frozen=True, eq=False)
class SceneJob:
    """Everything one scene needs; a job can be sent to another process.

    Args:
        seed: which town.
        options: how it is built.
        rig: cameras, pinhole, in an ego frame that stands on the ground.
        out: folder of the recording.
        key_frames: number of annotated frames, 0.5 s apart.
        sweeps: also store LiDAR sweeps between key frames, at 10 Hz.
        true_depth: also store the depth of every image as 16-bit PNG in centimetres.

    Raises:
        ValueError: nothing to record, longer than the town's traffic, or a rig the format cannot hold.
    """

    seed: int
    options: TownOptions
    rig: Rig
    out: Path
    key_frames: int
    sweeps: bool
    true_depth: bool

    def __post_init__(self) -> None:
        if self.key_frames < 1:
            raise ValueError(f"a scene has at least one key frame, got {self.key_frames}")
        if (self.key_frames - 1) * KEY_FRAME_S > self.options.duration_s:
            raise ValueError(
                f"{self.key_frames} key frames last {(self.key_frames - 1) * KEY_FRAME_S:g} s but traffic is planned "
                f"for {self.options.duration_s:g} s: set duration_s in TownOptions"
            )
        if not self.rig.ground.is_default:
            raise ValueError(
                f"rig '{self.rig.name}': a town is recorded by a rig whose ego origin stands on the ground (z = 0)"
            )
        for name, camera in self.rig.items():
            if not isinstance(camera.lens, Pinhole):
                raise ValueError(f"camera '{name}' has the lens {camera.lens}; nuScenes tables hold pinhole cameras only")

    @property
    def name(self) -> str:
        return f"town-{self.seed:04d}"


def record_scene(job: SceneJob, progress: Callable[[str], None] | None = None) -> Rows:
    """Render a scene into ``job.out`` and return the rows of its tables."""
    return _SceneRecorder(job).run(progress or (lambda line: None))


class _SceneRecorder:
    def __init__(self, job: SceneJob) -> None:
        self.job = job
        self.world: World = build_world(job.seed, job.options)
        self.tracer = Tracer(self.world)
        self.lidar = SpinningLidar()
        self.rows: Rows = {name: [] for name in TABLES}
        # instances of the same town have the same tokens whatever rig looks at them
        self.town = (job.seed, sorted(job.options.to_dict().items()))
        cameras = [(n, c.K.tolist(), c.width_px, c.height_px, c.ego_from_cam.matrix.tolist()) for n, c in job.rig.items()]
        self.id = token(*self.town, cameras)
        self.calibration: dict[str, Row] = {}
        self.chains: dict[str, list[Row]] = {name: [] for name in (*job.rig, "LIDAR_TOP")}
        self.annotations: dict[str, list[Row]] = {}

    def run(self, progress: Callable[[str], None]) -> Rows:
        self._calibrate()
        for k in range(self.job.key_frames):
            if k and self.job.sweeps:
                for j in range(1, SWEEPS_PER_KEY_FRAME):
                    time_s = (k - 1 + j / SWEEPS_PER_KEY_FRAME) * KEY_FRAME_S
                    self._sweep(self.tracer.at(time_s), k, key=False)
            self._key_frame(k)
            progress(f"{self.job.name}: key frame {k + 1} of {self.job.key_frames}")
        self._finish()
        return self.rows

    def _token(self, *parts: object) -> str:
        return token(self.id, *parts)

    def _timestamp_us(self, time_s: float) -> int:
        return _EPOCH_US + self.job.seed * 100_000_000 + round(time_s * 1e6)

    def _calibrate(self) -> None:
        mounts: dict[str, tuple[str, Pose, list[list[float]]]] = {
            name: ("camera", camera.ego_from_cam, intrinsic_field(camera)) for name, camera in self.job.rig.items()
        }
        mounts["LIDAR_TOP"] = ("lidar", self.lidar.ego_from_lidar, [])
        for name, (modality, pose, intrinsic) in mounts.items():
            self.rows["sensor"].append({"token": token("sensor", name), "channel": name, "modality": modality})
            row = {"token": self._token("calibration", name), "sensor_token": token("sensor", name), **pose_fields(pose)}
            self.calibration[name] = {**row, "camera_intrinsic": intrinsic}
            self.rows["calibrated_sensor"].append(self.calibration[name])

    def _key_frame(self, k: int) -> None:
        time_s = k * KEY_FRAME_S
        moment = self.tracer.at(time_s)
        sample: Row = {
            "token": self._token("sample", k),
            "timestamp": self._timestamp_us(time_s),
            "prev": "",
            "next": "",
            "scene_token": self._token("scene"),
        }
        self.rows["sample"].append(sample)
        points_world, world_from_ego = self._sweep(moment, k, key=True)
        contact = ContactShade(moment, world_from_ego.translation[:2])
        for name, camera in self.job.rig.items():
            view = render_camera(moment, camera, world_from_ego, contact=contact)
            self._store_image(name, view, time_s, k)
        self._annotate(moment, world_from_ego, points_world, sample["token"])

    def _data(
        self, channel: str, folder: str, suffix: str, time_s: float, k: int, size: tuple[int, int], key: bool
    ) -> tuple[Row, Pose]:
        """A row of sample_data with its ego pose."""
        stamp = self._timestamp_us(time_s)
        name = self._token(channel, stamp)
        pose_row = {"token": name, "timestamp": stamp, **pose_fields(self.world.world_from_ego(time_s))}
        self.rows["ego_pose"].append(pose_row)
        row = {
            "token": name,
            "sample_token": self._token("sample", k),
            "ego_pose_token": name,
            "calibrated_sensor_token": self.calibration[channel]["token"],
            "timestamp": stamp,
            "fileformat": "jpg" if suffix == ".jpg" else "pcd",
            "is_key_frame": key,
            "height": size[1],
            "width": size[0],
            "filename": f"{folder}/{channel}/{self.job.name}__{channel}__{stamp}{suffix}",
            "prev": "",
            "next": "",
        }
        self.rows["sample_data"].append(row)
        self.chains[channel].append(row)
        return row, read_back(pose_row)

    def _store_image(self, channel: str, view: View, time_s: float, k: int) -> None:
        height, width = view.image.shape[:2]
        row, _ = self._data(channel, "samples", ".jpg", time_s, k, (width, height), True)
        _write_image(self.job.out / row["filename"], view.image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        if self.job.true_depth:
            depth = np.clip(np.round(view.depth_m / DEPTH_UNIT_M), 0, 65535).astype(np.uint16)
            _write_image(self.job.out / "truth/depth" / channel / (Path(row["filename"]).stem + ".png"), depth, [])

    def _sweep(self, moment: Moment, k: int, key: bool) -> tuple[np.ndarray, Pose]:
        """Store a sweep; returns its points in the world as a reader of the file gets them, and the ego pose."""
        time_s = moment.time_s
        row, world_from_ego = self._data("LIDAR_TOP", "samples" if key else "sweeps", ".pcd.bin", time_s, k, (0, 0), key)
        rng = np.random.default_rng([self.job.seed, 1000 + round(time_s * 1000)])
        points = self.lidar.sweep(moment, world_from_ego, rng)
        path = self.job.out / row["filename"]
        path.parent.mkdir(parents=True, exist_ok=True)
        points.tofile(path)
        ego_points = read_back(self.calibration["LIDAR_TOP"]).apply(points[:, :3])
        return world_from_ego.apply(ego_points), world_from_ego

    def _annotate(self, moment: Moment, world_from_ego: Pose, points_world: np.ndarray, sample_token: str) -> None:
        """Write down whoever is near and met by a LiDAR point or seen by a camera."""
        boxes = self.world.boxes(moment.time_s)
        near = np.linalg.norm(boxes.centre_m[:, :2] - world_from_ego.translation[:2], axis=1) < ANNOTATED_M
        boxes = _as_read(boxes[near])
        counts = boxes.count_points(points_world)
        shares = visible_share(moment, self.job.rig, world_from_ego, list(boxes.instance_ids))
        for i in np.flatnonzero((counts > 0) | (shares > 0)):
            name = str(boxes.instance_ids[i])
            attribute = self.world.actors[self.world.number_of[name] - 1].attribute
            row = {
                "token": self._token("annotation", sample_token, name),
                "sample_token": sample_token,
                "instance_token": token(*self.town, name),
                "visibility_token": visibility_token(float(shares[i])),
                "attribute_tokens": [token("attribute", attribute)],
                **box_fields(boxes, int(i)),
                "prev": "",
                "next": "",
                "num_lidar_pts": int(counts[i]),
                "num_radar_pts": 0,
            }
            self.annotations.setdefault(name, []).append(row)
            self.rows["sample_annotation"].append(row)

    def _finish(self) -> None:
        """Links and the tables that need the whole scene."""
        chain(self.rows["sample"])
        for rows in self.chains.values():
            chain(rows)
        for name, rows in self.annotations.items():
            chain(rows)
            category = self.world.actors[self.world.number_of[name] - 1].category
            self.rows["instance"].append(
                {
                    "token": rows[0]["instance_token"],
                    "category_token": token("category", category),
                    "nbr_annotations": len(rows),
                    "first_annotation_token": rows[0]["token"],
                    "last_annotation_token": rows[-1]["token"],
                }
            )
        samples = self.rows["sample"]
        self.rows["scene"].append(
            {
                "token": self._token("scene"),
                "log_token": self._token("log"),
                "nbr_samples": len(samples),
                "name": self.job.name,
                "description": f"town of seed {self.job.seed}",
                "first_sample_token": samples[0]["token"],
                "last_sample_token": samples[-1]["token"],
            }
        )
        self.rows["log"].append(
            {
                "token": self._token("log"),
                "logfile": self.job.name,
                "vehicle": self.job.rig.name,
                "date_captured": "2020-09-13",
                "location": "town",
            }
        )
        filename = f"maps/{self.job.name}.png"
        _write_image(self.job.out / filename, _map_image(self.world.plan), [])
        self.rows["map"].append(
            {
                "token": self._token("map"),
                "log_tokens": [self._token("log")],
                "category": "semantic_prior",
                "filename": filename,
            }
        )


def _as_read(boxes: Boxes3D) -> Boxes3D:
    """The boxes after their yaw went through a quaternion, so that counts agree with a reader's to the last bit."""
    yaw = [Pose.from_quaternion(box_fields(boxes, i)["rotation"], np.zeros(3)).yaw_rad for i in range(len(boxes))]
    return Boxes3D.create(
        boxes.centre_m, boxes.size_m, yaw, boxes.labels, velocity_mps=boxes.velocity_mps, instance_ids=boxes.instance_ids
    )


def _map_image(plan: GroundPlan) -> np.ndarray:
    """Where one can drive, north up."""
    return np.ascontiguousarray(plan.asphalt[::-1])


def _write_image(path: Path, pixels: np.ndarray, flags: list[int]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    done, data = cv2.imencode(path.suffix, np.ascontiguousarray(pixels), flags)
    if not done:
        raise ValueError(f"{path}: the image cannot be encoded")
    path.write_bytes(data.tobytes())
