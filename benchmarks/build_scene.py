"""Seconds and memory to rebuild one scene of the town as Gaussians: 20 key frames, six cameras, LiDAR at 10 Hz.

Run ``python benchmarks/build_scene.py``; figures go to results/benchmarks/build_scene.json. The scene is recorded first, which
is not counted. The whole build is timed, from the recording on disk to the files of Gaussians, once per repetition into an
empty folder. Memory is the largest sum over all processes of the build, looked at four times a second (shared pages count
once per process, so it is an upper bound).
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import threading
from pathlib import Path

from coin3d.datasets.open import open_recording
from coin3d.geometry import preset_rig
from coin3d.records import write_json
from coin3d.scenes.build import build_scenes
from coin3d.scenes.options import BuildOptions
from coin3d.town import record

RESULT = Path(__file__).resolve().parents[1] / "results" / "benchmarks" / "build_scene.json"
BUSY_LOAD_PER_CORE = 0.5
SEED, KEY_FRAMES = 3000, 20


def resident_bytes(process: int) -> int:
    """Of a process and all its descendants; those that end meanwhile count nothing."""
    try:
        pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
        threads = list(Path(f"/proc/{process}/task").iterdir())
        children = {int(child) for thread in threads for child in (thread / "children").read_text().split()}
    except (OSError, IndexError):
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE") + sum(map(resident_bytes, children))


class PeakMemory:
    """Watches this process and its descendants while the block runs."""

    def __enter__(self) -> PeakMemory:
        self.bytes = 0
        self._over = threading.Event()
        self._watcher = threading.Thread(target=self._watch, daemon=True)
        self._watcher.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._over.set()
        self._watcher.join()

    def _watch(self) -> None:
        while not self._over.wait(0.25):
            self.bytes = max(self.bytes, resident_bytes(os.getpid()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, default=Path("out/build_scene"))
    parser.add_argument("--out", type=Path, default=RESULT)
    parser.add_argument("--width", type=int, default=400, help="of the images; the town's training width by default")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--repetitions", type=int, default=3)
    options = parser.parse_args()
    rig = preset_rig("nuscenes", options.width)
    recording = record(rig, options.work / f"recording_{options.width}", [SEED], key_frames=KEY_FRAMES, sweeps=True)
    load, cores = os.getloadavg()[0], os.cpu_count() or 1
    print(f"{cores} cores, load average before {load:.2f} (recording the scene just now counts)")
    seconds, processor_seconds, peaks = [], [], []
    for _ in range(options.repetitions):
        out = options.work / "scenes"
        shutil.rmtree(out, ignore_errors=True)
        with PeakMemory() as memory:
            outcome = build_scenes(
                open_recording(recording), out, BuildOptions(width_px=options.width), workers=options.workers
            )
        seconds.append(round(outcome.elapsed_s, 1))
        processor_seconds.append(round(sum(outcome.seconds.values()), 1))
        peaks.append(round(memory.bytes / 2**30, 2))
        size = sum(file.stat().st_size for file in out.glob("*/*.safetensors") if file.stem != "objects")
        print(f"{seconds[-1]} s, {processor_seconds[-1]} processor seconds, {peaks[-1]} GiB")
    facts = {
        "cores": cores,
        "load_before": round(load, 2),
        "width_px": options.width,
        "key_frames": KEY_FRAMES,
        "cameras": len(rig),
        "workers": options.workers,
        "seconds": seconds,
        "seconds_median": statistics.median(seconds),
        "processor_seconds_median": statistics.median(processor_seconds),
        "processor_seconds_by_step": {step: round(spent, 1) for step, spent in outcome.seconds.items()},
        "peak_gib": max(peaks),
        "megabytes_per_frame": round(size / 1e6 / KEY_FRAMES, 1),
    }
    write_json(options.out, facts)
    print(f"median {facts['seconds_median']} s, {facts['megabytes_per_frame']} MB per frame; figures in {options.out}")


if __name__ == "__main__":
    main()
