"""``coin3d demo``: the whole way on embedded data, ending in one HTML report."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from coin3d.commands.outcome import finish


def demo(
    out: Path,
    checkpoints: Annotated[
        tuple[str, ...], arg(metavar="CHECKPOINT ...", help_behavior_hint="(default: the shipped ones)")
    ] = (),
    workers: int = 0,
    device: str = "auto",
) -> None:
    """Two shipped detectors on the rig they were trained on and on a rig they have never seen; ends in one HTML report.

    Records the same worlds through a nuScenes-like and a Waymo-like rig (worlds that no training run used), detects with
    town-direct and town-coin3d on both, prints the table, and writes report.html, which opens without a network.

    Try:
      coin3d demo --out out/demo
      coin3d demo --out out/mine --checkpoints town-coin3d runs/petr/model.safetensors

    Args:
        out: folder for the report, the recordings and result.json.
        checkpoints: other detectors of cars: shipped names, or files of coin3d train.
        workers: processes that record; 0 takes one per core.
        device: auto, cpu, cuda, cuda:1 ...
    """
    from coin3d.commands.town import need_ray_casting
    from coin3d.demo import DemoOptions, run_demo

    need_ray_casting()
    options = DemoOptions(workers=workers, device=device)
    outcome = run_demo(out, replace(options, checkpoints=checkpoints) if checkpoints else options)
    finish(out, outcome.result(), outcome.pictures)
    print(f"report:  {outcome.report}")
