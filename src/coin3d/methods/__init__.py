"""Methods of transfer, one file each. Every one reaches a detector through the hooks of ``coin3d.detectors.method``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from coin3d.detectors.method import Method
from coin3d.methods.coin3d import CoIn3D, CoIn3DOptions
from coin3d.methods.direct import Direct, DirectOptions


@dataclass(frozen=True)
class NoOptions:
    """The plain detector has nothing to set."""


def _none(options: NoOptions) -> Method:
    return Method()


METHODS: dict[str, tuple[type, Any]] = {
    "none": (NoOptions, _none),
    "direct": (DirectOptions, Direct),
    "coin3d": (CoIn3DOptions, CoIn3D),
}
"""Name -> (options class, constructor from those options)."""

__all__ = ["METHODS", "CoIn3D", "CoIn3DOptions", "Direct", "DirectOptions", "Method", "NoOptions"]
