"""``coin3d rig``: one rig in numbers and pictures, two rigs compared, or a rig against those of a training."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from coin3d.geometry import RIG_PRESETS, Rig, load_rig, preset_rig
from coin3d.geometry.undistort import undistorted_rig
from coin3d.records import to_plain, write_bytes, write_json
from coin3d.rig_report.coverage import Coverage, coverage
from coin3d.rig_report.facts import CameraFacts, CameraPair, RigDifference, RigFacts, rig_difference, rig_facts
from coin3d.rig_report.figures import figure_png, ground_growth_figure, top_view_figure
from coin3d.rig_report.map_figure import prior_maps_figure
from coin3d.rig_report.page import Comparison, RigReport, write_rig_report
from coin3d.rig_report.prior_distance import CameraDistance, RigDistance, Span, rig_distance
from coin3d.rig_report.ring import pluecker_ring_figure
from coin3d.rig_report.text import difference_text, rig_table
from coin3d.rig_report.verdict import Verdict, advice, verdicts

__all__ = [
    "CameraDistance",
    "CameraFacts",
    "CameraPair",
    "Comparison",
    "Coverage",
    "RigDifference",
    "RigDistance",
    "RigFacts",
    "RigReport",
    "Span",
    "Verdict",
    "advice",
    "compare_rigs",
    "coverage",
    "find_rig",
    "rig_difference",
    "rig_distance",
    "rig_facts",
    "show_rig",
    "verdicts",
    "write_rig_report",
]

_PICTURES = {
    "top_view.png": top_view_figure,
    "prior_maps.png": prior_maps_figure,
    "ground_growth.png": ground_growth_figure,
    "pluecker_ring.png": pluecker_ring_figure,
}


def find_rig(name_or_path: str) -> Rig:
    """A preset by its name, or a rig file by its path; with the pinhole cameras that stand in for those with lenses.

    Raises:
        ValueError: neither a preset nor a readable rig file.
        FileNotFoundError: a path where no file is.
    """
    if name_or_path in RIG_PRESETS:
        return preset_rig(name_or_path)
    if Path(name_or_path).suffix in (".yaml", ".yml") or Path(name_or_path).is_file():
        return undistorted_rig(load_rig(name_or_path))
    return preset_rig(name_or_path)


def show_rig(rig: Rig, out: Path) -> str:
    """Draw one rig into ``out``, write ``out/result.json``, and return its table as text."""
    facts = rig_facts(rig)
    pictures = _draw([rig], out)
    write_json(out / "result.json", {"rig": to_plain(facts), "pictures": pictures})
    return rig_table(facts)


def compare_rigs(rig: Rig, other: Rig, out: Path) -> str:
    """Draw two rigs side by side into ``out``, write ``out/result.json``, and return tables and differences as text."""
    facts, other_facts = rig_facts(rig), rig_facts(other)
    change = rig_difference(facts, other_facts)
    pictures = _draw([rig, other], out)
    result: dict[str, Any] = {
        "rig": to_plain(facts),
        "other": to_plain(other_facts),
        "difference": to_plain(change),
        "pictures": pictures,
    }
    write_json(out / "result.json", result)
    return "\n\n".join([rig_table(facts), rig_table(other_facts), difference_text(facts, other_facts, change)])


def _draw(rigs: Sequence[Rig], out: Path) -> list[str]:
    for name, figure in _PICTURES.items():
        write_bytes(out / name, figure_png(figure(rigs)))
    return list(_PICTURES)
