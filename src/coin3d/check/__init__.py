"""``coin3d check``: draw a recording, count, and say in plain words what looks wrong with it."""

from coin3d.check.finding import Finding
from coin3d.check.run import CheckResult, check

__all__ = ["CheckResult", "Finding", "check"]
