"""Rows of results: what was measured, of what, under which protocol."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

from coin3d.datasets.classes import ClassMap
from coin3d.evaluation import DEFAULT_RANGE_M, Protocol, Report

if TYPE_CHECKING:
    from coin3d.inference import LoadedDetector  # with all of torch, which results files do without


def protocol_for(class_map: ClassMap, range_shape: Literal["radial", "square"] = "radial") -> Protocol:
    """The default protocol on the classes of a class map."""
    ranges = {name: DEFAULT_RANGE_M[name] for name in class_map.classes}
    return Protocol(name=class_map.name, classes=class_map.classes, range_m=ranges, range_shape=range_shape)


def result_row(detector: LoadedDetector, report: Report, source: str, target: str) -> dict[str, Any]:
    """One row of ``result.json``: who, from where, to where, and the numbers with their protocol."""
    return {
        "detector": detector.description["detector"],
        "method": detector.description["method"],
        "source": source,
        "target": target,
        **report.row(),
    }


COLUMNS = ("detector", "method", "source", "target", "mAP", "mATE", "mASE", "mAOE", "NDS*")


def rows_table(rows: Sequence[dict[str, Any]]) -> str:
    """The rows as aligned plain text."""
    cells = [list(COLUMNS), *([_cell(row[c]) for c in COLUMNS] for row in rows)]
    widths = [max(len(line[i]) for line in cells) for i in range(len(COLUMNS))]
    return "\n".join("  ".join(f"{text:<{width}}" for text, width in zip(line, widths, strict=True)).rstrip() for line in cells)


def _cell(value: Any) -> str:
    return f"{value:.3f}" if isinstance(value, float) else str(value)
