"""Which scenes and frames of its recordings ``coin3d train`` learns from, by flags or by a protocol of the paper."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coin3d.commands.evaluate import ClassChoice, class_map_for

if TYPE_CHECKING:
    from coin3d.datasets.classes import ClassMap
    from coin3d.datasets.frame import Recording
    from coin3d.evaluation.transfer import DataUse, TransferProtocol


@dataclass(frozen=True)
class Sources:
    """How recordings are opened for training.

    Args:
        class_map: which classes are learned.
        split: which scenes of every recording; None: all, or what the protocol says.
        every: every n-th frame of a scene.
        protocol: says so per data set.
    """

    class_map: ClassMap
    split: str | None = None
    every: int = 1
    protocol: TransferProtocol | None = None

    @property
    def selection(self) -> dict[str, Any] | None:
        """Plain data for run.json; None where everything is taken."""
        if self.protocol is not None:
            return {"protocol": self.protocol.name, "train_on": [use.describe() for use in self.protocol.source]}
        return None if self.split is None and self.every == 1 else {"split": self.split, "every": self.every}

    def open(self, path: Path) -> Recording:
        """The chosen frames of a recording.

        Raises:
            FileNotFoundError: no recording there.
            ValueError: no such scenes, or a data set that the protocol does not train on.
        """
        from coin3d.datasets.open import open_recording
        from coin3d.datasets.thinned import Thinned

        use = None if self.protocol is None else _use_of(self.protocol, path)
        split, every = (self.split, self.every) if use is None else (use.named_split, use.every)
        recording = open_recording(path, split)
        return recording if every == 1 else Thinned(recording, every)


def choose_sources(setting: str | None, split: str | None, every: int, classes: ClassChoice) -> Sources:
    """From the flags of the command line.

    Raises:
        ValueError: no such protocol, or one together with flags that it sets.
    """
    if every < 1:
        raise ValueError(f"--every is 1 (all frames) or more, got {every}")
    if setting is None:
        return Sources(class_map_for(classes), split, every)
    from coin3d.evaluation.paper_protocols import paper_protocol

    if split is not None or every != 1 or classes != "merged-car":
        raise ValueError(f"--protocol {setting} sets classes, split and frame rate; leave --classes, --split and --every out")
    protocol = paper_protocol(setting)
    return Sources(protocol.training_classes, protocol=protocol)


def _use_of(protocol: TransferProtocol, path: Path) -> DataUse:
    from coin3d.datasets.open import open_recording
    from coin3d.datasets.splits import data_set_of
    from coin3d.datasets.thinned import scene_names

    # Waymo's scenes are in no list: their folder is the split
    owner = data_set_of(set(scene_names(open_recording(path)))) or "waymo"
    for use in protocol.source:
        if use.data_set == owner:
            return use
    raise ValueError(
        f"{path}: protocol {protocol.name} trains on {', '.join(use.data_set for use in protocol.source)}; these scenes are of "
        f"{owner if owner != 'waymo' else 'neither nuScenes nor Lyft'}"
    )
