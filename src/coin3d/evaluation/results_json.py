"""The results file of the nuScenes detection task: read to score other people's detectors, written for other people's tools.

``{"meta": {...}, "results": {sample token: [box, ...]}}``, a box with ``translation`` and ``rotation`` (w, x, y, z) in the
world frame, ``size`` as width, length, height, ``detection_name`` and ``detection_score``. One sample is held at a time.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from coin3d.datasets.classes import CAR, KNOWN_CATEGORIES, PEDESTRIAN, TWO_WHEEL, ClassMap
from coin3d.datasets.json_stream import JsonStream
from coin3d.evaluation.box_table import BoxTable
from coin3d.geometry import Boxes3D, Pose

_LARGEST = 1e12
"""No metre or score is beyond."""
_META = {"use_camera": True, "use_lidar": False, "use_radar": False, "use_map": False, "use_external": False}
# the task has no name for all two-wheelers
DETECTION_NAMES: Mapping[str, str] = {
    **{
        name: name
        for name in ("truck", "bus", "trailer", "construction_vehicle", "motorcycle", "bicycle", "traffic_cone", "barrier")
    },
    CAR: "car",
    PEDESTRIAN: "pedestrian",
    TWO_WHEEL: "motorcycle",
}
"""Class name -> name in a results file."""


def read_results(path: Path, world_from_ego: Mapping[str, Pose], class_map: ClassMap, *, skip_others: bool = False) -> BoxTable:
    """Detections of a results file, in the ego frames of their samples.

    Velocities and attributes are not read. Boxes of names that the class map drops are left out.

    Args:
        path: the file.
        world_from_ego: sample token -> ego pose at the reference time.
        class_map: which names count as which class.
        skip_others: leave out samples that ``world_from_ego`` does not have, where only a part is to be scored.

    Raises:
        FileNotFoundError: no such file.
        ValueError: no results file, or a box that makes no sense; the message names the sample and the box.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such results file")
    found: dict[str, _Columns] = {}
    seen: set[str] = set()
    results = False
    with path.open(encoding="utf-8-sig") as file:
        stream = JsonStream(file, path)
        for key in stream.members():
            if key != "results":
                stream.value()
                continue
            results = True
            for token in stream.members():
                if token in seen:
                    raise stream.error(f"sample '{token}' comes twice")
                seen.add(token)
                boxes = stream.value()
                if token not in world_from_ego:
                    if skip_others:
                        continue
                    raise stream.error(
                        f"sample '{token}' is not in the recording: are results and recording of the same split?"
                    )
                try:
                    found[token] = _columns(token, boxes, world_from_ego[token], class_map)
                except ValueError as error:
                    raise ValueError(f"{path}: sample '{token}': {error}") from error
        stream.finish()
    if not results:
        raise ValueError(f'{path}: no \'results\' in it; a results file is {{"meta": ..., "results": {{sample: boxes}}}}')
    if seen and not found:
        raise ValueError(f"{path}: none of its {len(seen)} samples is among those to score, the first is '{next(iter(seen))}'")
    return _table(path, found, class_map.classes)


_Columns = tuple[np.ndarray, Float[np.ndarray, "k 8"]]
"""Labels, and x, y, z, length, width, height, yaw, score of the boxes of a sample."""


def _columns(token: str, boxes: Any, world_from_ego: Pose, class_map: ClassMap) -> _Columns:
    if not isinstance(boxes, list) or not all(isinstance(box, dict) for box in boxes):
        raise ValueError("its boxes are a list of objects")
    for i, box in enumerate(boxes):
        if box.get("sample_token", token) != token:
            raise ValueError(f"box {i} says sample_token {box['sample_token']!r:.60}")
        name = box.get("detection_name")
        if not isinstance(name, str) or name not in KNOWN_CATEGORIES:
            raise ValueError(f"box {i} has the detection_name {name!r:.60}, which class map '{class_map.name}' does not know")
    kept = [(i, box) for i, box in enumerate(boxes) if box["detection_name"] in class_map.mapping]
    place = {name: p for p, name in enumerate(class_map.classes)}
    label = np.array([place[class_map.mapping[box["detection_name"]]] for _, box in kept], dtype=np.int16)
    width_length_height = _numbers(kept, "size", 3)
    wxyz = _numbers(kept, "rotation", 4)
    norm = np.linalg.norm(wxyz, axis=1)
    if len(off := np.flatnonzero(~(np.abs(norm - 1) < 0.01))):
        raise ValueError(f"box {kept[off[0]][0]} has a rotation (w, x, y, z) of length {norm[off[0]]:g}, not 1")
    w, x, y, z = (wxyz / norm[:, None]).T
    heading_world = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), np.zeros(len(kept))], axis=1)
    heading = heading_world @ world_from_ego.rotation
    values = np.column_stack(
        [
            (_numbers(kept, "translation", 3) - world_from_ego.translation) @ world_from_ego.rotation,
            width_length_height[:, [1, 0, 2]],
            np.arctan2(heading[:, 1], heading[:, 0]),
            _numbers(kept, "detection_score", 0),
        ]
    )
    return label, values


def _numbers(boxes: list[tuple[int, dict[str, Any]]], field: str, width: int) -> Float[np.ndarray, "k ..."]:
    """A field of all boxes, (K, width), or (K,) for width 0."""
    values = [box.get(field) for _, box in boxes]
    column = _array(values, width)
    if column is not None:
        return column
    what = f"{width} finite numbers" if width else "a finite number"
    for (i, _), value in zip(boxes, values, strict=True):
        if _array([value], width) is None:
            raise ValueError(f"box {i} has the {field} {value!r:.80}, which should be {what}")
    return np.zeros((0, width) if width else 0)


def _array(values: list[Any], width: int) -> Float[np.ndarray, "k ..."] | None:
    """One row per value, None unless all are numbers of sane size and as many as there should be."""
    try:
        column = np.array(values)
    except ValueError:
        return None
    if column.shape != (len(values), width)[: 1 + (width > 0)] or column.dtype.kind not in "if":
        return None
    # among numbers, NumPy takes true for 1
    if bool in set(map(type, chain.from_iterable(values) if width else values)):
        return None
    sane = ((column >= -_LARGEST) & (column <= _LARGEST)).all()
    return np.asarray(column, dtype=np.float64) if sane else None


def _table(path: Path, found: dict[str, _Columns], classes: tuple[str, ...]) -> BoxTable:
    start = np.concatenate([[0], np.cumsum([len(label) for label, _ in found.values()], dtype=np.int64)])
    label, values = np.empty(start[-1], dtype=np.int16), np.empty((8, start[-1]))
    tokens = tuple(found)
    for s, token in enumerate(tokens):
        label[start[s] : start[s + 1]], rows = found.pop(token)  # what is copied is let go
        values[:, start[s] : start[s + 1]] = rows.T
    try:
        return BoxTable(tokens, start, classes, label, values[:3].T, values[3:6].T, values[6], values[7])
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def write_results(path: Path, detections: Iterable[tuple[str, Pose, Boxes3D]]) -> None:
    """Write a results file, sample by sample; the file appears whole or not at all.

    Args:
        path: the file.
        detections: (sample token, world_from_ego, boxes in the ego frame) of every sample. Two-wheelers are written as
            motorcycles; velocities that are not known as 0, attributes as "".

    Raises:
        ValueError: a class that the task has no name for.
        OSError: the file cannot be written.
    """
    partial = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with partial.open("w", encoding="utf-8") as file:
                file.write(f'{{"meta": {json.dumps(_META)}, "results": {{')
                for i, (token, world_from_ego, boxes) in enumerate(detections):
                    rows = _rows(token, boxes.transformed(world_from_ego))
                    file.write(f"{',' if i else ''}\n{json.dumps(token)}: {json.dumps(rows, allow_nan=False)}")
                file.write("\n}}\n")
            partial.replace(path)
        except BaseException:
            partial.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OSError(f"{path}: cannot be written ({error.strerror or error}); nothing was changed") from error


def _rows(token: str, boxes_world: Boxes3D) -> list[dict[str, Any]]:
    rows = []
    for i in range(len(boxes_world)):
        label = str(boxes_world.labels[i])
        if label not in DETECTION_NAMES:
            raise ValueError(f"sample '{token}': class '{label}' has no name in the nuScenes detection task")
        length, width, height = boxes_world.size_m[i].tolist()
        half_yaw = float(boxes_world.yaw_rad[i]) / 2
        rows.append(
            {
                "sample_token": token,
                "translation": boxes_world.centre_m[i].tolist(),
                "size": [width, length, height],
                "rotation": [np.cos(half_yaw).item(), 0.0, 0.0, np.sin(half_yaw).item()],
                "velocity": np.nan_to_num(boxes_world.velocity_mps[i]).tolist(),
                "detection_name": DETECTION_NAMES[label],
                "detection_score": float(boxes_world.scores[i]),
                "attribute_name": "",
            }
        )
    return rows
