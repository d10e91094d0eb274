"""Record towns to disk in nuScenes format, one scene per seed, in several processes, resuming where it stopped."""

from __future__ import annotations

import json
import math
import multiprocessing
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import cv2

from coin3d.geometry import Rig
from coin3d.town.nuscenes_writer import Rows, write_json, write_tables
from coin3d.town.options import TownOptions
from coin3d.town.scene_recorder import SceneJob, record_scene

TOWN_FORMAT = 1
"""Raised whenever the same seed gives another world or other pictures."""


def record(
    rig: Rig,
    out: Path,
    seeds: Sequence[int],
    *,
    options: TownOptions | None = None,
    key_frames: int = 20,
    sweeps: bool = False,
    true_depth: bool = False,
    workers: int = 1,
    progress: Callable[[str], None] = print,
) -> Path:
    """Drive a rig through towns and write the recording.

    The world of a seed is the same for every rig. Finished scenes are kept in ``out/scenes`` and skipped when the call is
    repeated, also with more seeds; the tables appear in ``out/v1.0-town`` once all scenes are there.

    Args:
        rig: pinhole cameras.
        out: folder of the recording.
        seeds: one scene each.
        options: options of the towns.
        key_frames: annotated frames per scene, at 2 Hz.
        sweeps: also LiDAR sweeps between key frames, at 10 Hz.
        true_depth: also depth images, ``out/truth/depth``: 16-bit PNG in centimetres, 0 for the sky.
        workers: processes.
        progress: called with one line per finished scene.

    Returns:
        The folder with the tables.

    Raises:
        ValueError: no or repeated seeds, or ``out`` holds a recording made with other settings.
    """
    options = options or TownOptions()
    if not seeds or len(set(seeds)) != len(seeds):
        raise ValueError(f"a recording needs one or more different seeds, got {list(seeds)}")
    jobs = [SceneJob(seed, options, rig, Path(out), key_frames, sweeps, true_depth) for seed in seeds]
    settings = _settings(jobs[0])
    _check_settings(Path(out), settings)
    todo = [job for job in jobs if not _done_file(job).is_file()]
    if len(todo) < len(jobs):
        progress(f"{len(jobs) - len(todo)} of {len(jobs)} scenes are there already")
    _run(todo, max(1, min(workers, len(todo))), progress)
    scenes: list[Rows] = [json.loads(_done_file(job).read_text()) for job in jobs]
    write_json(Path(out) / "town.json", {**settings, "seeds": list(seeds)})
    return write_tables(Path(out), scenes)


def _run(jobs: list[SceneJob], workers: int, progress: Callable[[str], None]) -> None:
    begin = time.monotonic()

    def tell(done: int, name: str) -> None:
        elapsed = time.monotonic() - begin
        left = elapsed / done * (len(jobs) - done)
        progress(f"{name} recorded ({done} of {len(jobs)}, {elapsed:.0f} s, about {left:.0f} s left)")

    if workers == 1:
        for done, job in enumerate(jobs, 1):
            tell(done, record_to_file(job))
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        futures = [pool.submit(record_to_file, job) for job in jobs]
        for done, future in enumerate(as_completed(futures), 1):
            tell(done, future.result())


def record_to_file(job: SceneJob) -> str:
    """Record one scene; its rows, written last, mark it as finished."""
    cv2.setNumThreads(1)
    write_json(_done_file(job), record_scene(job))
    return job.name


def _done_file(job: SceneJob) -> Path:
    return job.out / "scenes" / f"{job.name}.json"


def _settings(job: SceneJob) -> dict[str, Any]:
    cameras = {
        name: {"K": c.K.tolist(), "size": [c.width_px, c.height_px], "ego_from_cam": c.ego_from_cam.matrix.tolist()}
        for name, c in job.rig.items()
    }
    return {
        "town_format": TOWN_FORMAT,
        "options": job.options.to_dict(),
        "key_frames": job.key_frames,
        "sweeps": job.sweeps,
        "true_depth": job.true_depth,
        "rig": {"name": job.rig.name, "pixel_origin": "edge", "cameras": cameras},
    }


def _check_settings(out: Path, settings: dict[str, Any]) -> None:
    path = out / "town.json"
    if not path.is_file():
        write_json(path, {**settings, "seeds": []})
        return
    there = json.loads(path.read_text())
    changed = [key for key in settings if not _same(there.get(key), settings[key])]
    if changed:
        raise ValueError(
            f"{path}: the folder holds a recording with other {', '.join(changed)}; choose another folder or delete it"
        )


def _same(there: Any, wanted: Any) -> bool:
    """Equal but for rounding: the last digits of a calibration depend on the machine that computed them."""
    if isinstance(there, dict) and isinstance(wanted, dict):
        return there.keys() == wanted.keys() and all(_same(there[key], wanted[key]) for key in wanted)
    if isinstance(there, list) and isinstance(wanted, list):
        return len(there) == len(wanted) and all(map(_same, there, wanted))
    if isinstance(there, float) and isinstance(wanted, float):
        return math.isclose(there, wanted, rel_tol=1e-9, abs_tol=1e-9)
    return bool(there == wanted)
