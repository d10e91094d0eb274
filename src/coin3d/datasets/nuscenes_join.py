"""The tables of a nuScenes-format recording, read once and written as one record per key frame."""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Iterator
from contextlib import closing
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any

from coin3d.datasets.json_table import Tell, dangling
from coin3d.datasets.nuscenes_staging import Staging, encoded_part
from coin3d.datasets.nuscenes_tables import Sample, SmallTables
from coin3d.datasets.record_file import RecordWriter

_MAX_VELOCITY_GAP_S = 1.5
_MOST_PER_FRAME = 2000  # several times what any data set has
_SWEEPS_PER_RECORD = 1000
_TOKENS_PER_BUCKET = 64


def bucket_of(token: str, buckets: int) -> int:
    """Which of the records with tokens holds a token."""
    return zlib.crc32(token.encode(errors="surrogatepass")) % buckets


def write_joined(folder: Path, writer: RecordWriter, tell: Tell | None = None) -> dict[str, Any]:
    """Write calibrations, key frames, LiDAR sweeps and places of tokens as records; where they are, for the head.

    Args:
        folder: with the tables.
        writer: without records yet: calibration i becomes record i.
        tell: told the table and how many of its bytes are read, now and then.

    Raises:
        FileNotFoundError: a table is missing.
        ValueError: a table is damaged, a row makes no sense, a link of a key frame dangles, or a scene is empty.
    """
    small = SmallTables.read(folder, tell)
    samples, names, sensors = small.samples(), small.scene_names(), small.sensors()
    with closing(Staging(folder, small, samples, tell)) as staging:
        fields = ("translation", "rotation", "camera_intrinsic")
        for row in small.calibrated_sensor.rows():
            writer.add(encoded_part(small.calibrated_sensor.path, row, fields))
        first_frame = len(writer)
        _write_frames(staging, samples, writer)
        first_bucket = len(writer)
        buckets = _write_buckets(samples, writer)
        return {
            "cameras": sorted(sensors.cameras),
            "lidars": sorted(sensors.lidars),
            "scenes": _scenes(names, samples, _write_sweeps(staging, names, writer)),
            "first_frame": first_frame,
            "first_bucket": first_bucket,
            "buckets": buckets,
            "labelled": staging.labelled,
            "some_filename": staging.some_filename[:1000],
            "sweeps_problem": staging.sweeps_problem,
        }


def _write_frames(staging: Staging, samples: list[Sample], writer: RecordWriter) -> None:
    data = _Groups(staging.key_data())
    annotations = _Groups(staging.annotations())
    for i, sample in enumerate(samples):
        entries: dict[str, str] = {}
        for _, channel, token, pose_token, calibration, row, pose in data.take(i, staging.data_path, sample):
            if pose is None:
                raise dangling(staging.data_path, token, "ego_pose_token", pose_token, staging.pose_path)
            entries[channel] = f'{{"calibration":{calibration},"row":{row},"pose":{pose}}}'
        boxes, velocities = [], []
        for _, row, *tracked in annotations.take(i, staging.annotation_path, sample):
            boxes.append(row)
            velocities.append(json.dumps(_velocity(staging.annotation_path, *(tracked[k : k + 4] for k in (0, 4, 8)))))
        before, after = (samples[k].token if _same_scene(samples, i, k) else "" for k in (i - 1, i + 1))
        writer.add(
            f'{{"token":{json.dumps(sample.token)},"previous":{json.dumps(before)},"next":{json.dumps(after)},'
            f'"data":{{{",".join(f"{json.dumps(channel)}:{entry}" for channel, entry in entries.items())}}},'
            f'"annotations":[{",".join(boxes)}],"velocities":[{",".join(velocities)}]}}'
        )


def _same_scene(samples: list[Sample], i: int, k: int) -> bool:
    return 0 <= k < len(samples) and samples[k].scene == samples[i].scene


def _velocity(path: Path, own: list[Any], before: list[Any], after: list[Any]) -> list[float] | str | None:
    """Metres per second in the xy plane: centred difference over the neighbours, one-sided at the ends of a track.

    Args:
        path: of the annotations.
        own: token, time in seconds, x, y of an annotation.
        before: of the one before; without time where there is none.
        after: of the one after.

    Returns:
        vx, vy; None where they are not known; a text where a neighbour makes no sense.
    """
    first = last = own
    for neighbour in (before, after):
        _, time_s, x, y = neighbour
        if time_s is None or abs(time_s - own[1]) > _MAX_VELOCITY_GAP_S:
            continue
        if x is None or y is None:
            return f"{path}: row '{neighbour[0]}' has no sane translation"
        first, last = (neighbour, last) if neighbour is before else (first, neighbour)
    elapsed_s = last[1] - first[1]
    if elapsed_s <= 0 or own[2] is None:  # where it stands itself is looked at when the frame is read
        return None
    velocity = [(last[k] - first[k]) / elapsed_s for k in (2, 3)]
    return velocity if all(map(math.isfinite, velocity)) else None


def _write_sweeps(staging: Staging, names: list[str], writer: RecordWriter) -> dict[str, int]:
    """Scene name -> record that lists the time in ns and number of each record with sweeps of the scene.

    A new record begins at every key frame, so that what lies between two of them is read at once.
    """
    directories: dict[str, list[list[int]]] = {}
    for scene, rows in groupby(staging.sweeps(), key=itemgetter(0)):
        listed = directories.setdefault(names[scene], [])
        pending: list[str] = []
        start_ns = 0
        for _, time_us, is_key, token, pose_token, calibration, row, pose in rows:
            if pending and (is_key or len(pending) >= _SWEEPS_PER_RECORD):
                listed.append([start_ns, writer.add(f"[{','.join(pending)}]")])
                pending = []
            time_ns = round(float(time_us)) * 1000
            start_ns = start_ns if pending else time_ns
            if pose is None:
                pose = json.dumps(str(dangling(staging.data_path, token, "ego_pose_token", pose_token, staging.pose_path)))
            pending.append(f'{{"time_ns":{time_ns},"is_key":{is_key},"calibration":{calibration},"row":{row},"pose":{pose}}}')
        listed.append([start_ns, writer.add(f"[{','.join(pending)}]")])
    return {name: writer.add(json.dumps(sorted(listed))) for name, listed in directories.items()}


def _write_buckets(samples: list[Sample], writer: RecordWriter) -> int:
    """Records of {token: position}, so that a token is found without reading all of them; how many."""
    buckets: list[dict[str, int]] = [{} for _ in range(len(samples) // _TOKENS_PER_BUCKET + 1)]
    for i, sample in enumerate(samples):
        buckets[bucket_of(sample.token, len(buckets))][sample.token] = i
    for bucket in buckets:
        writer.add(json.dumps(bucket))
    return len(buckets)


def _scenes(names: list[str], samples: list[Sample], sweeps: dict[str, int]) -> list[list[Any]]:
    """Name, number of frames, record that lists the sweeps or -1, of every scene."""
    counts = [0] * len(names)
    for sample in samples:
        counts[sample.scene] += 1
    return [[name, count, sweeps.get(name, -1)] for name, count in zip(names, counts, strict=True)]


class _Groups:
    """Rows that come in the order of their first value, taken group by group.

    Args:
        rows: tuples.
    """

    def __init__(self, rows: Iterator[tuple[Any, ...]]) -> None:
        self._rows = rows
        self._next = next(rows, None)

    def take(self, key: int, path: Path, sample: Sample) -> list[tuple[Any, ...]]:
        """The rows of a key, none if there are none; keys are asked for in order.

        Raises:
            ValueError: more than a frame can hold.
        """
        found: list[tuple[Any, ...]] = []
        while self._next is not None and self._next[0] == key:
            if len(found) == _MOST_PER_FRAME:
                raise ValueError(f"{path}: sample '{sample.token}' has more than {_MOST_PER_FRAME} rows")
            found.append(self._next)
            self._next = next(self._rows, None)
        return found
