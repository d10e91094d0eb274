"""Recordings in DGP format, which DDAD is published in. Own reader of the JSON files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float

from coin3d.datasets.dgp_files import Calibration, PointCloudFile, columns_of, field, read_boxes, read_json, rows_of
from coin3d.datasets.dgp_scene import Datum, DgpSample, DgpScene
from coin3d.datasets.frame import Frame
from coin3d.datasets.ground_fit import fit_ground
from coin3d.datasets.inside import inside
from coin3d.datasets.json_values import shown, whole
from coin3d.datasets.own_vehicle import own_vehicle_masks
from coin3d.datasets.splits import SplitChoice, chosen_scenes
from coin3d.geometry import Boxes3D, Camera, GroundPlane, Pose, Rig

_SPLITS = ("train", "val", "test")
"""By their numbers in DGP."""
_MAX_VELOCITY_GAP_S = 1.5
_SWEEPS_FOR_GROUND = 5
_LIDAR_ABOVE_CAMERAS_M = 0.3
_LARGEST_SIDE_PX = 32767


class DgpRecording:
    """Samples of all scenes, in time order within each scene. Frames are built when asked for.

    The ego frame is the vehicle frame of the calibration at the time of the point cloud. Every datum has a world pose of
    its own, so a camera sits where it was when it fired (``time_sync = pose``). DDAD merges its scanners into the vehicle
    frame, which is not bound to touch the road: the rig's ground is fitted to point clouds of the scene.

    Args:
        root: folder with the JSON file that lists the scenes, or the folder of one scene.
        split: a split (train, val, test or their numbers 0, 1, 2), a text file with scene names, the names themselves, or None
            for all scenes.

    Raises:
        FileNotFoundError: no scene list and no scene.
        ValueError: a file is missing or damaged, or the recording has no such split.
    """

    def __init__(self, root: Path | str, split: int | SplitChoice | None = None) -> None:
        self.root = Path(root)
        number = _SPLITS.index(split) if isinstance(split, str) and split in _SPLITS else split
        files = _scene_files(self.root, number if isinstance(number, int) else None)
        names = {_scene_name(path, self.root): path for path in files}
        if len(names) < len(files):
            raise ValueError(f"{self.root}: several files scene_*.json in one folder of a scene; keep one")
        if number is not None and not isinstance(number, int):
            names = {name: names[name] for name in chosen_scenes(number, list(names), str(self.root))}
        self._scenes = [DgpScene(path, name) for name, path in names.items()]
        self._places = [(scene, i) for scene in self._scenes for i in range(len(scene.samples))]
        self._grounds: dict[str, GroundPlane] = {}

    def __len__(self) -> int:
        return len(self._places)

    def __iter__(self) -> Iterator[Frame]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, index: int) -> Frame:
        """The frame at a position.

        Raises:
            IndexError: beyond the end.
            ValueError: the calibration, a pose or the annotations of this frame make no sense.
        """
        scene, place = self._places[index]
        sample = scene.samples[place]
        calibration = scene.calibration(sample)
        world_from_ego = _world_from_ego(sample, calibration)
        neighbours = ["", *(s.reference.key for s in scene.samples), ""]
        return Frame(
            token=sample.reference.key,
            timestamp_ns=sample.reference.time_ns,
            rig=self._rig(scene, sample, calibration, world_from_ego),
            images={d.name: d.path for d in sample.cameras},
            world_from_ego=world_from_ego,
            boxes_world=_boxes_world(scene, place),
            lidar=None if sample.lidar is None else _lidar(sample, sample.lidar, calibration),
            scene=scene.name,
            previous=neighbours[place],
            next=neighbours[place + 2],
            own_vehicle=own_vehicle_masks(self.root, (d.name for d in sample.cameras)),
        )

    def scene_names(self) -> list[str]:
        """The scene of every frame, without building frames."""
        return [scene.name for scene, _ in self._places]

    def _rig(self, scene: DgpScene, sample: DgpSample, calibration: Calibration, world_from_ego: Pose) -> Rig:
        ego_from_world = world_from_ego.inverse()
        cameras = {}
        for datum in sample.cameras:
            _vehicle_from(calibration, datum)
            width, height = (_side(datum, side) for side in ("width", "height"))
            pose = ego_from_world @ datum.world_from_sensor()
            try:
                cameras[datum.name] = Camera(calibration.K[datum.name], width, height, pose)
            except ValueError as error:
                raise ValueError(f"{calibration.path}: camera '{datum.name}': {error}") from error
        try:
            return Rig(cameras, self._ground(scene), name=scene.name)
        except ValueError as error:
            raise ValueError(f"{calibration.path}: {error}") from error

    def _ground(self, scene: DgpScene) -> GroundPlane:
        if scene.name not in self._grounds:
            self._grounds[scene.name] = _fitted_ground(scene)
        return self._grounds[scene.name]


def is_dgp(root: Path) -> bool:
    """Whether a folder holds a scene list or a scene in DGP format."""
    return bool(_scene_lists(root)) or _is_scene_folder(root)


def _scene_lists(root: Path) -> list[Path]:
    found = []
    for path in sorted(root.glob("*.json")):
        before = b""
        with path.open("rb") as file:
            while part := file.read(2**20):
                if b'"scene_splits"' in before + part:
                    found.append(path)
                    break
                before = part[-20:]
    return found


def _is_scene_folder(root: Path) -> bool:
    return (root / "calibration").is_dir() and any(root.glob("scene_*.json"))


def _scene_files(root: Path, split: int | None) -> list[Path]:
    lists = _scene_lists(root)
    if len(lists) > 1:
        raise ValueError(f"{root}: several lists of scenes ({', '.join(p.name for p in lists)}); keep one")
    if not lists:
        if not _is_scene_folder(root):
            raise FileNotFoundError(f"{root}: neither a DGP scene list (JSON with scene_splits) nor a DGP scene")
        return sorted(root.glob("scene_*.json"))
    where = str(lists[0])
    splits = field(read_json(lists[0]), "scene_splits", where)
    if not isinstance(splits, dict):
        raise ValueError(f"{where}: 'scene_splits' names lists by number, got {shown(splits)}")
    if split is not None and str(split) not in splits:
        raise ValueError(f"{lists[0]}: no split {split}, there are {', '.join(splits)}")
    chosen = [splits[str(split)]] if split is not None else list(splits.values())
    paths = dict.fromkeys(inside(root, name, where) for entry in chosen for name in rows_of(entry, "filenames", where))
    if not paths:
        raise ValueError(f"{where}: lists no scenes")
    return list(paths)


def _scene_name(path: Path, root: Path) -> str:
    return "-".join(path.parent.relative_to(root).parts) or root.name


def _side(datum: Datum, side: str) -> int:
    return whole(field(datum.content, side, datum.where), f"{datum.where}: {side}", 1, _LARGEST_SIDE_PX)


def _vehicle_from(calibration: Calibration, datum: Datum) -> Pose:
    if datum.name not in calibration.vehicle_from_sensor:
        raise ValueError(f"{calibration.path}: knows no sensor '{datum.name}', only {', '.join(calibration.K)}")
    return calibration.vehicle_from_sensor[datum.name]


def _world_from_ego(sample: DgpSample, calibration: Calibration) -> Pose:
    return sample.reference.world_from_sensor() @ _vehicle_from(calibration, sample.reference).inverse()


def _lidar(sample: DgpSample, datum: Datum, calibration: Calibration) -> PointCloudFile:
    columns = columns_of(datum.content, datum.where)
    ego_from_lidar = _vehicle_from(calibration, datum)
    return PointCloudFile(datum.path, columns, ego_from_lidar, _rays_start(sample, ego_from_lidar, calibration))


def _rays_start(sample: DgpSample, ego_from_lidar: Pose, calibration: Calibration) -> Float[np.ndarray, "3"]:
    """Where the LiDAR's rays started, ego frame.

    Points that were merged into the vehicle frame come with an identity as mounting, and the scanners' places are not
    recorded. They stand on the roof among the cameras: a little above the cameras' mean is taken.
    """
    if not ego_from_lidar.allclose(Pose.identity()):
        return ego_from_lidar.translation
    places = [_vehicle_from(calibration, datum).translation for datum in sample.cameras]
    return np.asarray(np.mean(places, axis=0) + np.array([0, 0, _LIDAR_ABOVE_CAMERAS_M]))


def _fitted_ground(scene: DgpScene) -> GroundPlane:
    """Median over point clouds spread over the scene; z = 0 for a scene without any.

    Raises:
        ValueError: there are point clouds, but no plane in any of them.
    """
    samples = [(sample, sample.lidar) for sample in scene.samples]
    clouds = [(sample, lidar) for sample, lidar in samples if lidar is not None]
    if not clouds:
        return GroundPlane()
    heights, problem = [], "no plane in the lowest points"
    probes = np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]])
    for i in sorted({round(i) for i in np.linspace(0, len(clouds) - 1, _SWEEPS_FOR_GROUND)}):
        sample, datum = clouds[i]
        try:
            scan = _lidar(sample, datum, scene.calibration(sample)).load()
        except ValueError as error:  # reported when the frame itself is read
            problem = str(error)
            continue
        fit = fit_ground(scan.points_ego, scan.origin_ego)
        if fit is not None:
            heights.append(-(probes @ fit.plane.normal[:2] + fit.plane.offset_m) / fit.plane.normal[2])
    if not heights:
        raise ValueError(f"{scene.path}: the ground cannot be fitted to the point clouds of the scene: {problem}")
    under, ahead, left = np.median(heights, axis=0)
    return GroundPlane(np.array([(under - ahead) / 10, (under - left) / 10, 1.0]), -float(under))


def _boxes_world(scene: DgpScene, place: int) -> Boxes3D | None:
    boxes = _annotated(scene, scene.samples[place].reference)
    if boxes is None:
        return None
    near = [scene.samples[i] for i in (place - 1, place, place + 1) if 0 <= i < len(scene.samples)]
    tracks: dict[str, list[tuple[float, np.ndarray]]] = {}
    for sample in near:
        gap_s = (sample.reference.time_ns - scene.samples[place].reference.time_ns) * 1e-9
        there = boxes if gap_s == 0 else _annotated(scene, sample.reference) if abs(gap_s) <= _MAX_VELOCITY_GAP_S else None
        for name, centre in zip(there.instance_ids, there.centre_m, strict=True) if there is not None else ():
            tracks.setdefault(str(name), []).append((gap_s, centre[:2]))
    velocity = [_velocity_mps(tracks[str(name)]) if str(name) else np.full(2, np.nan) for name in boxes.instance_ids]
    return Boxes3D.create(
        boxes.centre_m,
        boxes.size_m,
        boxes.yaw_rad,
        boxes.labels,
        velocity_mps=np.array(velocity).reshape(-1, 2),
        instance_ids=boxes.instance_ids,
        num_lidar_points=boxes.num_lidar_points,
        visibility=boxes.visibility,
    )


def _annotated(scene: DgpScene, datum: Datum) -> Boxes3D | None:
    if datum.boxes_path is None:
        return None
    return read_boxes(datum.boxes_path, scene.categories).transformed(datum.world_from_sensor())


def _velocity_mps(track: list[tuple[float, Float[np.ndarray, "2"]]]) -> Float[np.ndarray, "2"]:
    """Centred difference over the neighbouring samples, one-sided at the ends of a track, NaN without neighbours."""
    (first_s, first), (last_s, last) = track[0], track[-1]
    return np.full(2, np.nan) if last_s <= first_s else np.asarray((last - first) / (last_s - first_s))
