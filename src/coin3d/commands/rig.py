"""``coin3d rig``: what a rig is, and how two rigs differ for a detector."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg


def rig(
    rig: Annotated[Positional[str], arg(metavar="RIG")],
    out: Path,
    other: Annotated[str | None, arg(metavar="RIG", help_behavior_hint="(default: none)")] = None,
) -> None:
    """Show a rig, or compare two: positions, fields of view, prior maps, growth of ground depth, Pluecker ring.

    Two rigs with different maps look different to a detector; CoIn3D gives it these maps to read.

    Try:
      coin3d rig nuscenes --out out/rig
      coin3d rig nuscenes --other waymo --out out/rigs
      coin3d rig recordings/van/rig.yaml --other lyft1 --out out/rigs

    Args:
        rig: a preset (nuscenes, lyft1, lyft2, waymo), a rig.yaml, or the folder of a recording (its first frame's rig).
        out: folder for result.json and the pictures.
        other: a second rig, to compare with.
    """
    from coin3d.commands.outcome import RESULT_FILE
    from coin3d.commands.rig_report import find_any_rig
    from coin3d.rig_report import compare_rigs, show_rig

    first = find_any_rig(rig)
    print(show_rig(first, out) if other is None else compare_rigs(first, find_any_rig(other), out))
    for picture in json.loads((out / RESULT_FILE).read_text(encoding="utf-8"))["pictures"]:
        print(f"picture: {out / picture}")
    print(f"result:  {out / RESULT_FILE}")
