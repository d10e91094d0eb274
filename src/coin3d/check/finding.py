"""What a check found: how bad, what, and what to do about it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

Severity = Literal["error", "warning", "note"]
Subject = Literal["cameras", "images", "boxes", "lidar", "ground", "poses", "time", "files"]


@dataclass(frozen=True)
class Finding:
    """One finding.

    Args:
        severity: ``error`` makes results wrong, ``warning`` may, ``note`` is for information.
        text: what was found, with its number.
        remedy: what to do.
        where: frame, camera or file; "" for the whole recording.
        about: what is to be corrected.
    """

    severity: Severity
    text: str
    remedy: str = ""
    where: str = ""
    about: Subject = "files"

    def __str__(self) -> str:
        place = f"{self.where}: " if self.where else ""
        return f"{self.severity}: {place}{self.text}" + (f" -> {self.remedy}" if self.remedy else "")

    def as_dict(self) -> dict[str, str]:
        """For JSON."""
        return asdict(self)
