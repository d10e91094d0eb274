"""``coin3d convert``: released weights of other implementations to a checkpoint of this one."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from coin3d.commands.outcome import RESULT_FILE, finish

_NAMED = 3


def convert(
    released: Annotated[Positional[Path], arg(metavar="RELEASED.pth")],
    out: Annotated[Positional[Path], arg(metavar="OUT.safetensors")],
    source: Annotated[
        str | None, arg(name="from", metavar="NAME", help_behavior_hint="(default: told by the weights, where they can)")
    ] = None,
) -> None:
    """Convert released weights of CoIn3D, BEVDepth, BEVFormer or PETR to a checkpoint that detect and evaluate take.

    The file is read as numbers alone: whatever else it holds is never run. Every weight is mapped, or left out with a reason
    that is printed and listed in OUT.result.json; a weight that is unknown, missing or of another shape ends the conversion
    and is named. docs/convert.md lists the files, and what is different from the programs they come from.

    Try:
      coin3d convert nuscenes.pth weights/nuscenes.safetensors --from coin3d-nuscenes
      coin3d convert bevformer_tiny_epoch_24.pth weights/bevformer.safetensors
      coin3d convert petr_vovnet_gridmask_p4_800x320-e2191752.pth weights/petr.safetensors --from petr-vov-mmdet3d

    Args:
        released: the file as it was released.
        out: the checkpoint to write.
        source: whose file it is: coin3d-nuscenes, coin3d-lyft, coin3d-waymo, coin3d-mix, bevformer-tiny, petr-vov,
            petr-vov-mmdet3d, megvii-2key, megvii-2key-da. Needed where several have the same names and shapes.
    """
    from coin3d.training.checkpoint import save_checkpoint
    from coin3d.training.released.released_file import read_released
    from coin3d.training.released.sources import recognised, source_named

    if out.suffix != ".safetensors" or out.is_dir():
        raise ValueError(f"{out}: the checkpoint to write is a file whose name ends in .safetensors")
    chosen = None if source is None else source_named(source)
    weights = read_released(released)
    try:
        if chosen is None:
            chosen = recognised(weights)
            print(f"{released}: names and shapes are those of {chosen.name} alone")
        converted = chosen.convert(weights)
        unused = chosen.keys.unused(weights)
    except ValueError as error:
        raise ValueError(f"{released}: {error}") from error
    print(f"{chosen.title}: {len(weights) - len(unused)} of {len(weights)} weights mapped")
    for line in _grouped(unused):
        print(f"left out: {line}")
    save_checkpoint(out, converted, chosen.description())
    print(f"weights: {out}")
    result = {
        "checkpoint": str(out),
        "released": str(released),
        "sha256": _sha256(released),
        "from": chosen.name,
        "told_by_the_weights": source is None,
        "title": chosen.title,
        "notes": chosen.notes,
        "detector": chosen.detector,
        "method": chosen.method,
        "classes": list(chosen.classes),
        "weights_read": len(weights),
        "weights_mapped": len(weights) - len(unused),
        "left_out": unused,
    }
    finish(out.parent, result, name=f"{out.stem}.{RESULT_FILE}")


def _grouped(unused: Mapping[str, str]) -> list[str]:
    by_reason: dict[str, list[str]] = {}
    for name, reason in unused.items():
        by_reason.setdefault(reason, []).append(name)
    lines = []
    for reason, names in by_reason.items():
        more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
        lines.append(f"{', '.join(names[:_NAMED])}{more}: {reason}")
    return lines


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
