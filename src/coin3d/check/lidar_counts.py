"""Do the boxes hold as many LiDAR points as annotated? An even share of them is another sweep, an uneven one a mistake."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coin3d.check.finding import Finding
from coin3d.check.frame_checks import FrameReport

_EVEN = 0.15  # points beside an even share, of all points found
_ENOUGH_POINTS = 100


def count_findings(reports: Sequence[FrameReport]) -> list[Finding]:
    """Boxes that hold another number of points than annotated, over all frames."""
    reports = [report for report in reports if report.counted]
    if not reports:
        return []
    found = np.concatenate([report.found_points for report in reports])
    annotated = np.concatenate([report.annotated_points for report in reports])
    if np.array_equal(found, annotated):
        return []
    worst = max(reports, key=lambda report: int(np.abs(report.found_points - report.annotated_points).max()))
    largest = int(np.abs(found - annotated).max())
    text = f"{int((found != annotated).sum())} of {len(found)} boxes hold another number of LiDAR points than annotated"
    share = found.sum() / max(int(annotated.sum()), 1)
    beside = np.abs(found - share * annotated).sum()
    if min(found.sum(), annotated.sum()) >= _ENOUGH_POINTS and beside <= _EVEN * found.sum():
        text += f", but evenly {share:.2f} times as many"
        return [Finding("note", text, "they were annotated on a denser sweep, or on several", about="boxes")]
    return [
        Finding(
            "warning",
            f"{text} (largest difference {largest})",
            "a few: annotated on another sweep; most: LiDAR pose, ego pose or box convention is wrong",
            worst.frame.token,
            "boxes",
        )
    ]
