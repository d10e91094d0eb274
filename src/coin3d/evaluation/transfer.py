"""What a number of the paper's tables means: trained on what, scored on what, under which rules, with every number."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from coin3d.datasets.classes import ClassMap
from coin3d.evaluation.protocol import DEFAULT_RANGE_M, Protocol
from coin3d.geometry import RIG_PRESETS

DataSet = Literal["nuscenes", "lyft", "waymo"]
TITLES = {"nuscenes": "nuScenes", "lyft": "Lyft", "waymo": "Waymo"}


@dataclass(frozen=True)
class DataUse:
    """A data set as one side of a comparison uses it.

    Args:
        data_set: which one.
        split: a list of scenes in ``datasets.splits``; of Waymo, the folder.
        scenes: how many it has when it is complete.
        frames: annotated frames of these scenes.
        rate_hz: of the annotated frames.
        every: use every n-th frame of each scene.
        look_back: what a detector with memory takes as the frame before is so many frames back, among those used.
        rendered_as: rig preset that the frames are rendered through; "" for the images as recorded.

    Raises:
        ValueError: a number below one, or an unknown rig.
    """

    data_set: DataSet
    split: str
    scenes: int
    frames: int
    rate_hz: float
    every: int = 1
    look_back: int = 1
    rendered_as: str = ""

    def __post_init__(self) -> None:
        if min(self.scenes, self.frames, self.every, self.look_back) < 1 or not self.rate_hz > 0:
            raise ValueError(f"{self.data_set} {self.split}: numbers of scenes, frames and steps are at least 1")
        if self.rendered_as and self.rendered_as not in RIG_PRESETS:
            raise ValueError(f"{self.data_set} {self.split}: no rig preset '{self.rendered_as}', only {', '.join(RIG_PRESETS)}")

    @property
    def named_split(self) -> str | None:
        """For ``open_recording``; None where a folder is the split."""
        return None if self.data_set == "waymo" else self.split

    def describe(self) -> str:
        """One line with every number."""
        parts = [f"{TITLES[self.data_set]} {self.split}: {self.scenes} scenes, {self.frames} frames at {self.rate_hz:g} Hz"]
        parts.append("every frame" if self.every == 1 else f"every {_ordinal(self.every)} frame")
        parts.append(f"frame before: {self.look_back * self.every / self.rate_hz:g} s earlier")
        if self.rendered_as:
            parts.append(f"rendered through the rig {self.rendered_as}")
        return ", ".join(parts)


@dataclass(frozen=True)
class TransferProtocol:
    """One row of the paper's tables: where a detector learns and where, by what rules, it is scored.

    Args:
        name: for the command line.
        source: what it is trained on; several are mixed frame by frame.
        target: what it is scored on.
        training_classes: class map of the training boxes.
        scoring_classes: class map of ground truth and predictions.
        input_px: width and height of the network's input.
        visible_only: score only objects whose centre falls into an image.
        drop_zero_lidar: do not ask for objects in which no LiDAR point was counted; unknown counts are kept.
        note: what else has to be known to compare numbers.

    Raises:
        ValueError: nothing to train on, or classes that are scored but not trained.
    """

    name: str
    source: tuple[DataUse, ...]
    target: DataUse
    training_classes: ClassMap
    scoring_classes: ClassMap
    input_px: tuple[int, int]
    visible_only: bool = True
    drop_zero_lidar: bool = True
    note: str = ""

    def __post_init__(self) -> None:
        if not self.source:
            raise ValueError(f"protocol '{self.name}' trains on nothing")
        if missing := [c for c in self.scoring_classes.classes if c not in self.training_classes.classes]:
            raise ValueError(f"protocol '{self.name}' scores {', '.join(missing)}, which it does not train")

    @property
    def scoring(self) -> Protocol:
        """The rules of the score."""
        classes = self.scoring_classes.classes
        return Protocol(
            name=self.name,
            classes=classes,
            range_m={c: DEFAULT_RANGE_M[c] for c in classes},
            visible_only=self.visible_only,
            drop_zero_lidar=self.drop_zero_lidar,
        )

    @property
    def is_oracle(self) -> bool:
        """Whether it learns from the data set, and through the rig, that it is scored on."""
        return {(use.data_set, use.rendered_as) for use in self.source} == {(self.target.data_set, self.target.rendered_as)}

    def describe(self) -> str:
        """Several lines with every number."""
        width, height = self.input_px
        return "\n".join(
            [
                f"{self.name}{' (oracle)' if self.is_oracle else ''}",
                *(f"  train on    {use.describe()}" for use in self.source),
                f"  score on    {self.target.describe()}",
                f"  train       {_classes(self.training_classes)}",
                f"  score       {_classes(self.scoring_classes)}",
                f"  input       {width} x {height} pixels: resized to the width, bottom rows kept, black above if too low",
                "  time        cameras stand where they were when they fired; boxes are where the LiDAR saw them",
                f"  rules       {self.scoring.describe()}",
                *([f"  note        {self.note}"] if self.note else []),
            ]
        )

    def row(self) -> dict[str, Any]:
        """The same for ``result.json``."""
        return {
            "name": self.name,
            "train_on": [use.describe() for use in self.source],
            "score_on": self.target.describe(),
            "training_classes": self.training_classes.name,
            "scoring_classes": self.scoring_classes.name,
            "input_px": list(self.input_px),
            "rules": self.scoring.describe(),
            "note": self.note,
        }


def _classes(class_map: ClassMap) -> str:
    return f"{', '.join(class_map.classes)} ({class_map.name}: {len(class_map.mapping)} category names)"


def _ordinal(number: int) -> str:
    return {2: "2nd", 3: "3rd"}.get(number, f"{number}th")
