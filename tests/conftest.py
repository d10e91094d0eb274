"""Shapes are checked while tests run, skipped tests fail in CI, and fixtures shared by all tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

# before anything of coin3d is imported: every annotated shape and type is then checked at every call
install_import_hook("coin3d", "runtime_types.check")

from tiny_recording import write_recording  # noqa: E402

_CHECKOUT = Path(__file__).resolve().parents[1]
_IN_CI = os.environ.get("CI", "").lower() in ("1", "true")
_skipped_in_ci: list[str] = []

# CI tries the same examples each time, so that it fails for a change and not by luck; elsewhere they are drawn anew
settings.register_profile("ci", derandomize=True, deadline=None)
settings.register_profile("local", deadline=None)
settings.load_profile("ci" if _IN_CI else "local")


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Remember skipped tests in CI, where everything but a GPU is expected to be there."""
    if _IN_CI and report.skipped and not hasattr(report, "wasxfail") and "gpu" not in report.keywords:
        _skipped_in_ci.append(report.nodeid)


def pytest_collectreport(report: pytest.CollectReport) -> None:
    """The same for whole files."""
    if _IN_CI and report.skipped:
        _skipped_in_ci.append(report.nodeid)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """A run that skipped something is not a passed run in CI."""
    if _skipped_in_ci and session.exitstatus == pytest.ExitCode.OK:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say why the run failed."""
    if _skipped_in_ci:
        terminalreporter.section("skipped, which fails in CI", red=True)
        terminalreporter.write_line("\n".join(_skipped_in_ci))


def _real(name: str) -> Path:
    root = Path(os.environ.get("COIN3D_TEST_DATA", _CHECKOUT.parent / "shared" / "data"))
    if not (root / name).is_dir():
        pytest.skip(f"the real recording {name} is not in {root} (environment variable COIN3D_TEST_DATA)")
    return root / name


@pytest.fixture
def one_real_frame() -> Path:
    """Folder of one complete nuScenes key frame."""
    return _real("nuscenes_one_frame")


@pytest.fixture
def lyft_tables() -> Path:
    """Folder of Lyft tables of one sample, without images."""
    return _real("lyft_tables")


@pytest.fixture
def ddad_three_frames() -> Path:
    """Folder of one DGP scene with the rig of DDAD: three samples with boxes."""
    return _real("ddad_three_frames")


@pytest.fixture
def waymo_one_frame(tmp_path: Path) -> Path:
    """Folder of one Waymo v1 frame, linked to, because the reader keeps its index beside the file."""
    folder = tmp_path / "waymo"
    folder.mkdir()
    (folder / "frame.tfrecord").symlink_to(next(_real("waymo_v1_one_frame").glob("*.tfrecord")).resolve())
    return folder


@pytest.fixture
def tiny_recording(tmp_path: Path) -> Path:
    """Folder of a small synthetic recording in nuScenes format, see tiny_recording.py."""
    return write_recording(tmp_path / "tiny")
