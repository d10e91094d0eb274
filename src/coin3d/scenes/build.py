"""Build the Gaussians of all key frames of a recording: resumable, parallel, with the same bytes each time.

OUT/settings.json             what the build was made with; another build into the folder is refused
OUT/SCENE/rig.yaml            the rig of its first frame
OUT/SCENE/TOKEN.safetensors   Gaussians of a key frame
OUT/SCENE/meshes, objects.safetensors, quality/TOKEN.json     products of the steps
OUT/scenes.json               quality of all frames, and which scenes are better left raw
OUT/timing.json               seconds by step of the last call; the only file that differs between two builds
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from coin3d.datasets.frame import Frame, Recording
from coin3d.datasets.inside import plain_name
from coin3d.geometry import save_rig
from coin3d.records import from_plain, to_plain, write_json
from coin3d.rendering.gaussian_folder import RIG_FILE, SCENES_FILE
from coin3d.scenes.frame_quality import FrameQuality
from coin3d.scenes.options import BuildOptions
from coin3d.scenes.pictures import draw_scene
from coin3d.scenes.pool import single_threaded_processes
from coin3d.scenes.split import SweepsOf, no_sweeps
from coin3d.scenes.steps import SceneJob, Seconds, assemble, fuse_scene, model, see, start_worker

SCENES_FORMAT = 1
"""Raised whenever the same recording and options give other Gaussians."""

_TELL_EVERY_S = 5.0
_STEPS_PER_FRAME = 2  # depth, Gaussians


@dataclass(frozen=True, eq=False)
class SceneResult:
    """What became of a scene.

    Args:
        name: of the scene.
        raw_only: why training should use its raw images only, or "".
        frames: quality by frame, in time order.
    """

    name: str
    raw_only: str
    frames: tuple[FrameQuality, ...]


@dataclass(frozen=True, eq=False)
class BuildOutcome:
    """What came out.

    Args:
        scenes: in the order of the recording.
        seconds: processor seconds by step, of this call.
        elapsed_s: wall time of this call.
    """

    scenes: tuple[SceneResult, ...]
    seconds: Seconds
    elapsed_s: float

    @property
    def frames(self) -> list[FrameQuality]:
        """Quality of all frames."""
        return [frame for scene in self.scenes for frame in scene.frames]

    @property
    def raw_only(self) -> dict[str, str]:
        """Scenes better left raw, with the reason."""
        return {scene.name: scene.raw_only for scene in self.scenes if scene.raw_only}


def build_scenes(
    recording: Recording,
    out: Path,
    options: BuildOptions | None = None,
    *,
    workers: int = 1,
    progress: Callable[[str], None] = print,
) -> BuildOutcome:
    """Build all scenes of a recording. Called again, it continues where it stopped.

    Sweeps between key frames are used where the recording has a method ``sweeps``, as nuScenes-format ones have.

    Args:
        recording: annotated frames with LiDAR.
        out: folder for the scenes.
        options: how.
        workers: processes; several work on one scene together.
        progress: called with a line now and then.

    Raises:
        ValueError: ``out`` holds scenes built with other options, the recording has no boxes, or a file of it is damaged.
    """
    options = options or BuildOptions()
    _check_settings(out, options)
    jobs = _jobs(recording, out, options)
    began = time.monotonic()
    clock = _Clock(_STEPS_PER_FRAME * sum(len(job.frames) for job in jobs), progress)
    # a thread per active scene hands its steps to the shared processes in order
    with single_threaded_processes(workers, start_worker) as pool, ThreadPoolExecutor(max(1, workers)) as drivers:
        results = list(drivers.map(lambda job: _build_scene(job, pool, clock), jobs))
    outcome = BuildOutcome(tuple(results), clock.seconds, time.monotonic() - began)
    write_json(out / SCENES_FILE, {"scenes": to_plain(outcome.scenes), "raw_only": outcome.raw_only})
    write_json(out / "timing.json", {"elapsed_s": round(outcome.elapsed_s, 2), "workers": workers, "seconds": clock.rounded()})
    return outcome


@dataclass(eq=False)
class _Clock:
    """Adds up the seconds of all steps and says how long it will take."""

    steps: int
    progress: Callable[[str], None]
    seconds: Seconds = field(default_factory=dict)
    _done: int = 0
    _fresh: int = 0
    _began: float = field(default_factory=time.monotonic)
    _told: float = field(default_factory=time.monotonic)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def add(self, seconds: Seconds) -> None:
        with self._lock:
            for step, spent in seconds.items():
                self.seconds[step] = self.seconds.get(step, 0.0) + spent

    def skip(self, frames: int) -> None:
        """Frames that an earlier call finished."""
        with self._lock:
            self._done += _STEPS_PER_FRAME * frames

    def frame_step(self, future: Future[Seconds]) -> None:
        """Count a finished step of a frame; what was there already (no seconds) does not make the estimate rosy."""
        if future.cancelled() or future.exception() is not None:
            return
        self.add(future.result())
        with self._lock:
            self._done += 1
            self._fresh += bool(future.result())
            now = time.monotonic()
            if now - self._told < _TELL_EVERY_S and self._done < self.steps:
                return
            self._told = now
            spent = now - self._began
            left = spent / max(self._fresh, 1) * (self.steps - self._done)
            frames = self.steps // _STEPS_PER_FRAME
            self.progress(f"{self._done / self.steps:.0%} of {frames} frames, {spent:.0f} s, about {left:.0f} s left")

    def rounded(self) -> Seconds:
        return {step: round(spent, 2) for step, spent in self.seconds.items()}


def _build_scene(job: SceneJob, pool: Executor, clock: _Clock) -> SceneResult:
    """All steps of a scene; within a step its frames are worked on at the same time."""
    job.files.folder.mkdir(parents=True, exist_ok=True)
    save_rig(job.frames[0].rig, job.files.folder / RIG_FILE)
    if job.files.picture.is_file() and all(_finished(job, i) for i in range(len(job.frames))):
        clock.skip(len(job.frames))
        _drop_what_only_the_build_needs(job)  # a build that was killed while doing so is finished all the same
        return _result(job)
    clock.add(pool.submit(fuse_scene, job).result())
    # every frame's depth, also of finished ones: others take colours from it
    _for_all_frames(see, job, pool, clock)
    clock.add(pool.submit(model, job).result())
    _for_all_frames(assemble, job, pool, clock)
    clock.add(pool.submit(draw_scene, job).result())
    _drop_what_only_the_build_needs(job)
    return _result(job)


def _drop_what_only_the_build_needs(job: SceneJob) -> None:
    if not job.options.keep_depth:
        job.files.drop_depth()


def _for_all_frames(step: Callable[[SceneJob, int], Seconds], job: SceneJob, pool: Executor, clock: _Clock) -> None:
    futures = []
    for i in range(len(job.frames)):
        futures.append(pool.submit(step, job, i))
        futures[-1].add_done_callback(clock.frame_step)
    for future in futures:
        future.result()  # raises what went wrong


def _finished(job: SceneJob, index: int) -> bool:
    token = job.frames[index].token
    return job.files.quality(token).is_file() and job.files.gaussians(token).is_file()


def _result(job: SceneJob) -> SceneResult:
    figures = [json.loads(job.files.quality(frame.token).read_text()) for frame in job.frames]
    frames = tuple(from_plain(FrameQuality, figure) for figure in figures)
    return SceneResult(job.name, _raw_only(job, frames), frames)


def _raw_only(job: SceneJob, frames: Sequence[FrameQuality]) -> str:
    if all(frame.lidar is None for frame in job.frames):
        return "no frame has LiDAR, so all depth is guessed"
    known = sum(frame.known_below_horizon for frame in frames) / len(frames)
    if known < job.options.min_known:
        return f"only {known:.0%} of the pixels below the horizon have measured depth"
    psnr_db = sum(frame.psnr_db for frame in frames) / len(frames)
    if psnr_db < job.options.min_psnr_db:
        return f"its own images are rendered with {psnr_db:.1f} dB only"
    return ""


def _jobs(recording: Recording, out: Path, options: BuildOptions) -> list[SceneJob]:
    sweeps_of: SweepsOf = getattr(recording, "sweeps", no_sweeps)
    by_scene: dict[str, list[Frame]] = {}
    for frame in recording:
        if frame.boxes_world is None:
            raise ValueError(
                f"frame {frame.token} has no boxes: scenes are split by annotations into background and objects, so they "
                "can only be built from an annotated recording"
            )
        plain_name(frame.token, "a frame's token")  # scenes and frames become names of files
        by_scene.setdefault(plain_name(frame.scene or "scene", f"frame {frame.token}: scene"), []).append(frame)
    jobs = []
    for name, frames in by_scene.items():
        frames.sort(key=lambda frame: frame.timestamp_ns)
        sweeps = tuple(tuple(sweeps_of(frame)) for frame in frames)
        jobs.append(SceneJob(name, tuple(frames), sweeps, out / name, options))
    return jobs


def _check_settings(out: Path, options: BuildOptions) -> None:
    settings: dict[str, Any] = {"scenes_format": SCENES_FORMAT, "options": {k: repr(v) for k, v in vars(options).items()}}
    path = out / "settings.json"
    if not path.is_file():
        write_json(path, settings)
        return
    there = json.loads(path.read_text())
    if there != settings:
        mine, theirs = settings["options"], there.get("options", {})
        changed = [name for name in mine if theirs.get(name) != mine[name]] or ["version"]
        raise ValueError(f"{path}: the folder holds scenes built with other {', '.join(changed)}; choose another or delete it")
