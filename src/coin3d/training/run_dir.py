"""What a run leaves behind, so that a number can be traced: configuration, versions, code state, data fingerprint."""

from __future__ import annotations

import hashlib
import importlib.metadata
import os
import platform
import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from coin3d.datasets.index_place import is_index

_VERSIONED = ("coin3d", "numpy", "opencv-python-headless", "timm", "torch")


def environment() -> dict[str, Any]:
    """Versions and machine, for the run directory."""
    versions = {}
    for name in _VERSIONED:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            versions[name] = "not installed"
    return {"versions": versions, "python": platform.python_version(), "machine": platform.machine(), "cpus": os.cpu_count()}


def git_state() -> str:
    """Commit of the source tree, with '+changes' if it is modified; '' outside a checkout."""
    commit = _git("rev-parse", "HEAD")
    return commit + ("+changes" if commit and _git("status", "--porcelain", "--untracked-files=no") else "")


def _git(*words: str) -> str:
    here = Path(__file__).resolve().parent
    try:
        done = subprocess.run(["git", *words], cwd=here, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip()


def fingerprint(folders: Iterable[Path]) -> str:
    """Hash over names and sizes of all files of the data, and the content of tables: changes when the data does.

    Indexes that readers keep beside the data are none of it.
    """
    digest = hashlib.sha256()
    for folder in folders:
        for path in sorted(p for p in Path(folder).rglob("*") if p.is_file() and not is_index(p)):
            digest.update(f"{path.relative_to(folder)} {path.stat().st_size}\n".encode())
            if path.suffix in (".json", ".yaml"):
                digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
