"""``coin3d check``: look at a recording before trusting it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg


def check(
    path: Annotated[Positional[Path], arg(metavar="RECORDING")],
    out: Path,
    frames: int = 3,
    split: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="(default: all scenes)")] = None,
    undistort: bool = True,
) -> None:
    """Draw LiDAR and boxes into every image of a recording, count, and say what looks wrong.

    Do this first with anything of your own: most failures on a new rig are a transform stored the wrong way round.
    Without LiDAR, rings on the ground at 5, 10, 20 and 40 m are drawn instead; they must lie on the road.

    Try:
      coin3d check recordings/van --out out/check
      coin3d check out/demo/data/nuscenes --out out/check --frames 5

    Args:
        path: folder of the recording.
        out: folder for result.json and the pictures.
        frames: how many frames to look at, evenly spread.
        split: look at these scenes: a split of nuScenes, Lyft or DDAD (val), or a text file with scene names.
        undistort: look at images of cameras with lenses as detectors get them; --no-undistort shows them as recorded.
    """
    from coin3d.check import check as run_check
    from coin3d.commands.outcome import RESULT_FILE

    run_check(path, out, frames, split, undistort)
    print(f"result:  {out / RESULT_FILE}")
