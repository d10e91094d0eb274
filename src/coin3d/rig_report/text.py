"""The facts of a rig as text for the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from coin3d.rig_report.facts import GROWTH_AT_M, INPUT_WIDTH_PX, RigDifference, RigFacts

_HEADER = (
    "camera", "size", "f px", f"f at {INPUT_WIDTH_PX}", "(500/f)^2", "FoV h x v", "yaw", "pitch", "roll", "height m",
    "position m", "ground from", f"m/row at {GROWTH_AT_M:.0f} m",
)  # fmt: skip


def rig_table(facts: RigFacts) -> str:
    """One row per camera, and what the rig sees around the vehicle."""
    rows = [_HEADER]
    for c in facts.cameras:
        rows.append(
            (
                c.name,
                f"{c.size_px[0]} x {c.size_px[1]}",
                f"{c.focal_px:.0f}",
                f"{c.input_focal_px:.0f}",
                f"{c.inverse_focal:.2f}",
                f"{c.fov_deg[0]:.0f} x {c.fov_deg[1]:.0f}",
                _signed(c.yaw_deg),
                _signed(c.pitch_deg),
                _signed(c.roll_deg),
                f"{c.height_m:.2f}",
                " ".join(_signed(v, 2) for v in c.position_m),
                "-" if c.nearest_ground_m is None else f"{c.nearest_ground_m:.1f} m",
                "-" if c.growth_m_per_row is None else f"{c.growth_m_per_row:.2f}",
            )
        )
    seen = f"sees {facts.covered_deg:.0f} of 360 degrees, {facts.overlapping_deg:.0f} of them with two cameras or more"
    return f"{facts.name}: {len(facts.cameras)} cameras, {seen}\n{_aligned(rows)}"


def difference_text(rig: RigFacts, other: RigFacts, change: RigDifference) -> str:
    """What a detector trained on ``rig`` meets on ``other``."""
    lines = [f"from {rig.name} to {other.name}:"]
    if change.camera_count_change:
        lines.append(f"  {len(rig.cameras)} cameras become {len(other.cameras)}")
    lines.append(
        f"  coverage {rig.covered_deg:.0f} -> {other.covered_deg:.0f} degrees, "
        f"overlap {rig.overlapping_deg:.0f} -> {other.overlapping_deg:.0f} degrees"
    )
    rows = [(f"camera of {other.name}", f"nearest of {rig.name}", "yaw", "pitch", f"f at {INPUT_WIDTH_PX}", "height")]
    for pair in change.pairs:
        rows.append(
            (
                pair.other,
                pair.camera,
                f"{_signed(pair.yaw_change_deg)} deg",
                f"{_signed(pair.pitch_change_deg)} deg",
                f"x {pair.input_focal_ratio:.2f}",
                f"{_signed(pair.height_change_m, 2)} m",
            )
        )
    unpaired = sorted({c.name for c in rig.cameras} - {p.camera for p in change.pairs})
    lines.append(_aligned(rows))
    if unpaired:
        lines.append(f"  no counterpart in {other.name}: {', '.join(unpaired)}")
    return "\n".join(lines)


def _signed(value: float, digits: int = 1) -> str:
    return f"{round(value, digits) + 0.0:+.{digits}f}"  # adding zero turns -0.0 into +0.0


def _aligned(rows: Sequence[tuple[str, ...]]) -> str:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return "\n".join("  " + "  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows)
