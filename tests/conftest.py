"""Fixtures shared by all tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tiny_recording import write_recording

_CHECKOUT = Path(__file__).resolve().parents[1]


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
def tiny_recording(tmp_path: Path) -> Path:
    """Folder of a small synthetic recording in nuScenes format, see tiny_recording.py."""
    return write_recording(tmp_path / "tiny")
