"""A user's own recording: images, ``rig.yaml`` and ``frames.jsonl``, with poses, boxes and LiDAR where there are any."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from coin3d.datasets.folder import RIG_FILE
from coin3d.datasets.frame import Frame
from coin3d.datasets.frame_line import boxes_world, images_and_rig, lidar_of, world_from_ego
from coin3d.datasets.frames_file import FRAMES_FILE, read_place, read_places
from coin3d.datasets.inside import inside
from coin3d.datasets.json_values import parse_object, shown
from coin3d.datasets.own_vehicle import own_vehicle_masks
from coin3d.datasets.splits import SplitChoice, chosen_scenes
from coin3d.geometry import Pose, Rig, load_rig
from coin3d.geometry.rig_file import rig_from_dict

_RIGS_KEPT = 16


class OwnRecording:
    """Frames that ``frames.jsonl`` lists (docs/your_rig.md): scene by scene, by time within a scene.

    Args:
        root: folder with ``frames.jsonl``; ``rig.yaml`` beside it unless every frame names its own rig.
        split: which scenes: a text file or names; by default all.

    Raises:
        FileNotFoundError: no such file.
        ValueError: a line or the rig file makes no sense, or the recording has no such scenes.
    """

    def __init__(self, root: Path | str, split: SplitChoice | None = None) -> None:
        self.root = Path(root)
        self.path = self.root / FRAMES_FILE
        if not self.path.is_file():
            raise FileNotFoundError(f"{self.path}: no such file; docs/your_rig.md describes it")
        places = read_places(self.path, self.root.resolve().name)
        scenes = set(chosen_scenes(split, list(dict.fromkeys(place.scene for place in places)), str(self.path)))
        self._places = [place for place in places if place.scene in scenes]
        self._rig = load_rig(self.root / RIG_FILE) if (self.root / RIG_FILE).is_file() else None
        self._rigs: dict[Path, Rig] = {}

    def __len__(self) -> int:
        return len(self._places)

    def __iter__(self) -> Iterator[Frame]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, index: int) -> Frame:
        """The frame at a position.

        Raises:
            IndexError: beyond the end.
            ValueError: what the line says makes no sense.
        """
        index = range(len(self))[index]
        place = self._places[index]
        where = f"{self.path}, line {place.line}"
        entry = read_place(self.path, place)
        rig = self._rig_of(entry.get("rig"), where)
        pose = world_from_ego(entry, rig, where)
        images, rig_then = images_and_rig(entry, rig, pose, self.root, where)
        return Frame(
            token=place.token,
            timestamp_ns=place.time_ns,
            rig=rig_then,
            images=images,
            world_from_ego=Pose.identity() if pose is None else pose,
            boxes_world=boxes_world(entry, rig, pose, where),
            lidar=lidar_of(entry, rig, self.root, where),
            scene=place.scene,
            previous=self._neighbour(index, -1),
            next=self._neighbour(index, 1),
            own_vehicle=own_vehicle_masks(self.root, images),
        )

    def scene_names(self) -> list[str]:
        """The scene of every frame, without building frames."""
        return [place.scene for place in self._places]

    def _neighbour(self, index: int, step: int) -> str:
        there = index + step
        if not 0 <= there < len(self) or self._places[there].scene != self._places[index].scene:
            return ""
        return self._places[there].token

    def _rig_of(self, said: object, where: str) -> Rig:
        if said is None:
            if self._rig is None:
                raise ValueError(f"{where}: names no rig, and there is no {self.root / RIG_FILE}")
            return self._rig
        path = inside(self.root, said, f"{where}: rig")
        if path not in self._rigs:
            # every frame may have a rig of its own; neighbours are asked for together
            if len(self._rigs) >= _RIGS_KEPT:
                self._rigs.pop(next(iter(self._rigs)))
            try:
                self._rigs[path] = read_rig(path)
            except (ValueError, FileNotFoundError) as error:
                raise ValueError(f"{where}: rig {shown(said)}: {error}") from error
        return self._rigs[path]


def read_rig(path: Path) -> Rig:
    """A rig file in YAML, or the same content as JSON, which programs read faster.

    Raises:
        FileNotFoundError: no such file.
        ValueError: it makes no sense.
    """
    if path.suffix != ".json":
        return load_rig(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such rig file")
    try:
        return rig_from_dict(parse_object(path.read_bytes(), str(path)), default_name=path.stem)
    except ValueError as error:
        raise ValueError(str(error) if str(error).startswith(str(path)) else f"{path}: {error}") from error
