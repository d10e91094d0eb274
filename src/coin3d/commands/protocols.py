"""``coin3d protocols``: what the numbers of the paper's tables mean. And recordings as a protocol uses them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from coin3d.commands.outcome import finish

if TYPE_CHECKING:
    from coin3d.datasets.frame import Recording
    from coin3d.evaluation.transfer import TransferProtocol


def protocols(
    name: Annotated[Positional[str | None], arg(metavar="NAME", help_behavior_hint="(default: all)")] = None,
    out: Annotated[Path | None, arg(metavar="PATH", help_behavior_hint="(default: only print)")] = None,
) -> None:
    """Print the paper's comparisons with every number: data, classes, ranges, filters, frame rates, input sizes.

    Try:
      coin3d protocols
      coin3d protocols waymo-to-nuscenes
      coin3d protocols --out out/protocols
      coin3d evaluate runs/waymo/model.safetensors data/nuscenes --out out/score --protocol waymo-to-nuscenes

    Args:
        name: one of them.
        out: folder for result.json.
    """
    from coin3d.evaluation.paper_protocols import PAPER_PROTOCOLS, paper_protocol

    chosen = PAPER_PROTOCOLS if name is None else (paper_protocol(name),)
    print("\n\n".join(protocol.describe() for protocol in chosen))
    if out is not None:
        finish(out, {"protocols": [protocol.row() for protocol in chosen]})


def open_target(protocol: TransferProtocol, path: Path, detected: tuple[str, ...]) -> Recording:
    """The recording that a protocol scores on: its split, at its frame rate, with its frame before.

    Args:
        protocol: which.
        path: folder of the recording.
        detected: the classes a detector knows.

    Raises:
        ValueError: the recording is of another data set, or the detector does not know the classes.
    """
    from coin3d.datasets.open import open_recording
    from coin3d.datasets.splits import data_set_of
    from coin3d.datasets.thinned import Thinned, scene_names

    found = {protocol.scoring_classes.mapping.get(name) for name in detected}
    if missing := [c for c in protocol.scoring_classes.classes if c not in found]:
        raise ValueError(
            f"protocol {protocol.name} scores {', '.join(missing)}, but this checkpoint only knows {', '.join(detected)}"
        )
    use = protocol.target
    recording = open_recording(path)
    owner = data_set_of(set(scene_names(recording)))
    if owner != (None if use.data_set == "waymo" else use.data_set):
        raise ValueError(
            f"{path}: protocol {protocol.name} scores on {use.data_set}, but these scenes are "
            f"{f'of {owner}' if owner else 'not known to be of it'}"
        )
    if use.named_split is not None:
        recording = open_recording(path, use.named_split)
    return recording if use.every == use.look_back == 1 else Thinned(recording, use.every, use.look_back)
