"""``coin3d pretrain``: teach an image trunk what images of a recording show, before a detector starts from it."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import OmitArgPrefixes, Positional, arg

from coin3d.commands.evaluate import ClassChoice, class_map_for
from coin3d.commands.outcome import finish
from coin3d.commands.train import DetectorName, Optimisation


def pretrain(
    data: Annotated[Positional[tuple[Path, ...]], arg(metavar="RECORDING", help_behavior_hint="")],
    out: Path,
    detector: DetectorName = "bevdepth",
    preset: Literal["tiny", "small", "paper"] = "tiny",
    classes: ClassChoice = "merged-car",
    pretrained: bool = False,
    seed: int = 0,
    device: str = "auto",
    optimisation: OmitArgPrefixes[Optimisation] = Optimisation(),
) -> None:
    """Train the image trunk of a detector on LiDAR depth and on what each image cell shows.

    Meant for transformers, whose queries can tell little from features that mean nothing yet. Train it once per recording and
    share it among everything that is compared. Presets tiny of all detectors have the same trunk. The output folder is laid
    out like that of coin3d train, and the same command again continues an interrupted run.

    Try:
      coin3d pretrain data/train --out runs/trunk
      coin3d train data/train --out runs/petr --detector petr --trunk runs/trunk/model.safetensors

    Args:
        data: folders of recordings in nuScenes format; several are mixed frame by frame.
        out: folder of the run.
        detector: whose trunk.
        preset: of which size.
        classes: which names count as objects (docs/datasets.md).
        pretrained: start from ImageNet weights, which are downloaded.
        seed: of weights, data order and augmentation.
        device: auto, cpu, cuda, cuda:1 ...
        optimisation: how long and how fast; what is not given comes from the preset.
    """
    from coin3d.detectors import DETECTORS, TrunkConfig
    from coin3d.inference import resolve_device
    from coin3d.methods import METHODS
    from coin3d.training.loop import LOG_FILE
    from coin3d.training.options import TrainOptions
    from coin3d.training.train import train as run

    if not data:
        raise ValueError("name at least one recording to train on: coin3d pretrain FOLDER --out RUN")
    options = optimisation.applied_to(getattr(TrainOptions, preset)(), seed)
    began = time.monotonic()
    weights = run(
        data,
        out,
        detector="trunk",
        config=replace(TrunkConfig.of(getattr(DETECTORS[detector][0], preset)()), pretrained=pretrained),
        method="none",
        method_options=METHODS["none"][0](),
        class_map=class_map_for(classes),
        options=options,
        device=resolve_device(device),
    )
    last = json.loads((out / LOG_FILE).read_text(encoding="utf-8").splitlines()[-1])
    result = {
        "checkpoint": str(weights),
        "data": [str(path) for path in data],
        "detector": "trunk",
        "preset": preset,
        "classes": classes,
        "steps": options.steps,
        "seconds": round(time.monotonic() - began, 1),
        "last_losses": last["losses"],
    }
    print(f"weights: {weights}")
    finish(out, result, [out / "curves.png"])
