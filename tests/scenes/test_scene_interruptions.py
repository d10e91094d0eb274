"""Killed at every write, or out of disk space: what was built stays whole, and the next call ends with the same bytes."""

import os
import resource
import shutil
import signal
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from coin3d import cli
from coin3d.datasets.open import open_recording
from coin3d.geometry import preset_rig
from coin3d.scenes import build as module
from coin3d.scenes.options import BuildOptions
from coin3d.town import record
from tiny_recording import write_recording


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(tmp_path_factory.mktemp("recording") / "tiny", scenes=1, samples=2)


@pytest.fixture(scope="module")
def whole(recording: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    out = tmp_path_factory.mktemp("whole")
    assert build(recording, out) == 0
    return contents(out)


def build(recording: Path, out: Path) -> int:
    return cli.main(["build-scenes", str(recording), "--out", str(out), "--width", "96", "--workers", "1"])


def contents(out: Path) -> dict[str, bytes]:
    own_times = {"timing.json", "result.json"}
    return {str(p.relative_to(out)): p.read_bytes() for p in out.rglob("*") if p.is_file() and p.name not in own_times}


def in_child(work: Callable[[], int]) -> int:
    """Wait status of a forked process that does the work and exits with what it returns."""
    child = os.fork()
    if child == 0:
        status = 99
        try:
            status = work()
        finally:
            os._exit(status)
    return os.waitpid(child, 0)[1]


def killed_at_file(number: int, recording: Path, out: Path) -> int:
    """Build, but be killed between writing a file under its temporary name and renaming it; the first file is number 1."""
    rename, done = Path.replace, []

    def replace(self: Path, target: Path) -> Path:
        if len(done) == number - 1:
            os.kill(os.getpid(), signal.SIGKILL)
        done.append(target)
        return rename(self, target)

    Path.replace = replace  # type: ignore[method-assign, assignment]
    return build(recording, out)


def test_killed_at_every_file(recording: Path, whole: dict[str, bytes], tmp_path: Path) -> None:
    killed = 0
    while os.WIFSIGNALED(in_child(partial(killed_at_file, killed + 1, recording, tmp_path / str(killed)))):
        found = contents(tmp_path / str(killed))
        named = {name: data for name, data in found.items() if not name.endswith(".part")}
        assert len(found) == len(named) + 1, "it was killed with a file under its temporary name"
        assert all(named[name] == whole[name] for name in named if name in whole), "a file under its name is whole"
        assert build(recording, tmp_path / str(killed)) == 0
        assert contents(tmp_path / str(killed)) == whole
        killed += 1
    assert killed >= len(whole), "every file was once the last"


@pytest.mark.parametrize("limit_bytes", [2_000, 40_000, 200_000])
def test_a_full_disk_is_one_clear_error(
    limit_bytes: int, recording: Path, whole: dict[str, bytes], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A limit on the size of files refuses to write as a full disk does."""

    def limited() -> int:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, limit_bytes))
        return build(recording, tmp_path)

    assert os.waitstatus_to_exitcode(in_child(limited)) == 2
    (line,) = [line for line in capfd.readouterr().err.splitlines() if line.startswith("coin3d: error:")]
    assert str(tmp_path) in line and "cannot be written" in line
    found = contents(tmp_path)
    assert not [name for name in found if name.endswith(".part")]
    assert all(found[name] == whole[name] for name in found if name in whole)
    assert build(recording, tmp_path) == 0
    assert contents(tmp_path) == whole


def test_a_sweep_that_is_missing_is_named(
    recording: Path, whole: dict[str, bytes], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    copy = shutil.copytree(recording, tmp_path / "tiny")
    sweep = next(iter(sorted((copy / "sweeps").rglob("*.bin"))))
    data = sweep.read_bytes()
    for damaged in (None, data[: len(data) // 2 + 3]):
        sweep.unlink() if damaged is None else sweep.write_bytes(damaged)
        assert build(copy, tmp_path / "out") == 2
        assert sweep.name in capfd.readouterr().err
    sweep.write_bytes(data)
    assert build(copy, tmp_path / "out") == 0
    assert contents(tmp_path / "out") == whole


def test_the_builder_needs_no_truth(tmp_path: Path) -> None:
    """True depth lies beside the town's recordings for whoever scores; without it the same Gaussians come out."""
    full = preset_rig("nuscenes", width_px=96)
    pair = full.with_cameras({name: full[name] for name in ("CAM_FRONT", "CAM_BACK")})
    record(pair, tmp_path / "with", [5], key_frames=1, true_depth=True, progress=lambda line: None)
    truth = tmp_path / "with" / "truth"
    assert len(list(truth.rglob("*.png"))) == 2
    results = []
    for name in ("first", "second"):
        out = tmp_path / name
        module.build_scenes(open_recording(tmp_path / "with"), out, BuildOptions(width_px=96), progress=lambda line: None)
        results.append(contents(out))
        truth.rename(tmp_path / "hidden") if truth.exists() else None
    assert results[0] == results[1]
