"""``coin3d rig report``: can a network that was trained on other rigs run on this one?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

if TYPE_CHECKING:
    from coin3d.geometry import Rig
    from coin3d.training.seen_rigs import TrainingRigs

_INPUT_PX = (704, 256)


def rig_report(
    rig: Annotated[Positional[str], arg(metavar="RIG")],
    out: Path,
    checkpoint: Annotated[str | None, arg(metavar="WEIGHTS", help_behavior_hint="(default: none)")] = None,
    against: Annotated[tuple[str, ...], arg(metavar="RIG ...", help_behavior_hint="(default: those of the checkpoint)")] = (),
) -> None:
    """Can I run this on my cameras? A rig on one page: what it covers, and what is new to a trained network.

    Each camera and each prior map is compared with those of the training rigs. Geometry only: how well a network copes with a
    difference is not predicted. Without --checkpoint and --against the page is about the rig alone.

    Try:
      coin3d rig report recordings/van --out out/van
      coin3d rig report recordings/van --checkpoint runs/mine/model.safetensors --out out/van
      coin3d rig report recordings/van/rig.yaml --against nuscenes lyft1 --out out/van
      coin3d rig report waymo --checkpoint town-coin3d --against nuscenes --out out/waymo

    Args:
        rig: a preset (nuscenes, lyft1, lyft2, waymo), a rig.yaml, or the folder of a recording (its first frame's rig).
        out: folder for report.html, its pictures and result.json.
        checkpoint: what was trained: a shipped name or a file. It knows its training rigs if it was trained by a version that
            stores them; else name them with --against. Without it the network input is 704 x 256.
        against: training rigs to compare with, given like RIG; they take the place of those that the checkpoint stores, and
            are augmented as its method tells.
    """
    from coin3d.commands.outcome import RESULT_FILE
    from coin3d.rig_report.page import REPORT_FILE, write_rig_report
    from coin3d.rig_report.text import rig_table

    training, method, source = _training(checkpoint, against)
    report = write_rig_report(find_any_rig(rig), out, training, method=method, source=source)
    print(rig_table(report.facts) if report.comparison is None else report.comparison.text())
    for picture in report.pictures:
        print(f"picture: {out / picture}")
    print(f"report:  {out / REPORT_FILE}")
    print(f"result:  {out / RESULT_FILE}")


def find_any_rig(name: str) -> Rig:
    """A preset, a rig file, or the rig of the first frame of a recording."""
    from coin3d.datasets.open import open_recording
    from coin3d.rig_report import find_rig

    return open_recording(name)[0].rig if Path(name).is_dir() else find_rig(name)


def _training(checkpoint: str | None, against: tuple[str, ...]) -> tuple[TrainingRigs | None, str | None, str]:
    """Training rigs if any were given, the method, and where the rigs come from in words."""
    from coin3d.inference import checkpoint_path
    from coin3d.training.checkpoint import read_description
    from coin3d.training.seen_rigs import TrainingRigs, named_rigs, rigs_of_description

    if checkpoint is None:
        if not against:
            return None, None, ""
        return TrainingRigs(tuple(map(find_any_rig, against)), _INPUT_PX), None, "No checkpoint was given."
    path = checkpoint_path(checkpoint)
    description = read_description(path)
    method = str(description["method"])
    if against:
        rigs = named_rigs([find_any_rig(name) for name in against], description, str(path))
        return rigs, method, f"Checkpoint {path.name}, compared with rigs that were named."
    stored = rigs_of_description(description, str(path))
    if stored is None:
        raise ValueError(
            f"{path}: this checkpoint does not know its training rigs (it was converted, or trained before they were stored); "
            "name them: --against RIG ... (presets, rig files or recordings)"
        )
    return stored, method, f"Checkpoint {path.name}."
