"""``coin3d train``: from recordings with labels and LiDAR to a checkpoint."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import OmitArgPrefixes, Positional, arg

from coin3d.commands.evaluate import ClassChoice
from coin3d.commands.outcome import finish
from coin3d.commands.sources import choose_sources

if TYPE_CHECKING:
    from coin3d.augmentation import NovelViewOptions
    from coin3d.methods import CoIn3DOptions
    from coin3d.training.options import TrainOptions

_PRESET = "(default: the preset's)"
_Count = Annotated[int | None, arg(metavar="N", help_behavior_hint=_PRESET)]
_Rate = Annotated[float | None, arg(metavar="X", help_behavior_hint=_PRESET)]

DetectorName = Literal["bevdepth", "bevformer", "petr"]
PriorName = Literal["IF", "GD", "GG", "PR"]
PRIOR_FIELDS = {"IF": "inverse_focal", "GD": "ground_depth", "GG": "ground_gradient", "PR": "pluecker"}


@dataclass(frozen=True)
class Optimisation:
    """How long and how fast; ``None`` leaves the preset's.

    Args:
        steps: optimiser steps.
        batch_size: frames per step.
        learning_rate: peak learning rate.
        backbone_rate: share of it for the image trunk; 0.1 is usual for a trunk that was trained before.
        cameras_per_sample: train on this many randomly chosen cameras of each frame; 0 means all.
        keep_unseen_boxes: also ask for boxes that no camera of the sample sees, as the released code does.
        precision: number format of the forward pass; bfloat16 pays where the hardware has it.
        workers: loader processes.
        save_every: steps between resumable states.
    """

    steps: _Count = None
    batch_size: _Count = None
    learning_rate: _Rate = None
    backbone_rate: _Rate = None
    cameras_per_sample: _Count = None
    keep_unseen_boxes: bool = False
    precision: Annotated[Literal["float32", "bfloat16"] | None, arg(help_behavior_hint=_PRESET)] = None
    workers: _Count = None
    save_every: _Count = None

    def applied_to(self, preset: TrainOptions, seed: int) -> TrainOptions:
        """The preset with what was given put in its place."""
        given = {name: value for name, value in vars(self).items() if value is not None}
        shared = {name: given.pop(name) for name in ("cameras_per_sample", "keep_unseen_boxes") if name in given}
        if shared:
            given["augment"] = replace(preset.augment, **shared)
        return replace(preset, seed=seed, **given)


@dataclass(frozen=True)
class CoIn3DFlags:
    """The switches of the method; ``coin3d.methods.coin3d.CoIn3DOptions`` explains them.

    Args:
        focal_augmentation: zoom training images by 0.7 to 1.4, K follows.
        placement: released: modulate backbone levels and neck, as the released code does for BEVDepth, whose default it is;
            paper: the neck only, the default of the other detectors.
        projector: convolutions that embed the priors.
        priors: which prior maps: inverse focal, ground depth, ground gradient, Pluecker rays.
        modulate: no: only concatenate the maps.
    """

    focal_augmentation: bool = True
    placement: Annotated[Literal["released", "paper"] | None, arg(help_behavior_hint="(default: the detector's)")] = None
    projector: Literal["conv1", "conv1+conv1", "conv3", "conv3+conv3"] = "conv3"
    priors: tuple[PriorName, ...] = ("IF", "GD", "GG", "PR")
    modulate: bool = True

    def options(self, detector: str, width_px: int) -> CoIn3DOptions:
        """The method's own options, for a detector and the width of its input."""
        from coin3d.methods import CoIn3DOptions
        from coin3d.priors import PriorOptions, PriorSet

        if not self.priors:
            raise ValueError("--priors needs at least one of IF, GD, GG, PR; without any, take --method none")
        return CoIn3DOptions(
            placement=self.placement or ("released" if detector == "bevdepth" else "paper"),
            priors=PriorSet(**{field: name in self.priors for name, field in PRIOR_FIELDS.items()}),
            projector=self.projector,
            modulate=self.modulate,
            focal_augmentation=self.focal_augmentation,
            maps=PriorOptions().resolved(width_px),
        )


@dataclass(frozen=True)
class NovelViewFlags:
    """Training on rendered views; ``coin3d.augmentation.NovelViewOptions`` explains them.

    Args:
        gaussians: folder of built scenes; turns novel views on, for the methods coin3d and direct.
        novel_view_probability: chance of a sample to be rendered instead of raw.
        rig_ranges: paper: the paper's ranges around the recording's own rig; target-aware-lyft, target-aware-waymo: ranges
            of the released code for these sources, which bracket the rig of nuScenes.
        vary_array: also drop and add cameras and lay them out anew; a sample may then have a single camera, so take a batch
            size of two or more.
    """

    gaussians: Annotated[Path | None, arg(metavar="DIR", help_behavior_hint="(default: raw images only)")] = None
    novel_view_probability: float = 0.5
    rig_ranges: Literal["paper", "target-aware-lyft", "target-aware-waymo"] = "paper"
    vary_array: bool = False

    def options(self) -> NovelViewOptions | None:
        """The method's option, None without Gaussians."""
        from coin3d.augmentation import ArrayChange, NovelViewOptions, RigSampler

        if self.gaussians is None:
            if self != NovelViewFlags():
                raise ValueError("novel views are rendered from Gaussians: say with --gaussians where the built scenes are")
            return None
        ranges = {
            "paper": RigSampler,
            "target-aware-lyft": RigSampler.target_aware_lyft,
            "target-aware-waymo": RigSampler.target_aware_waymo,
        }
        sampler = ranges[self.rig_ranges]()
        if self.vary_array:
            sampler = replace(sampler, array=ArrayChange())
        return NovelViewOptions(self.novel_view_probability, sampler)


def train(
    data: Annotated[Positional[tuple[Path, ...]], arg(metavar="RECORDING", help_behavior_hint="")],
    out: Path,
    method: Literal["none", "direct", "coin3d"] = "coin3d",
    preset: Literal["tiny", "small", "paper"] = "tiny",
    detector: DetectorName = "bevdepth",
    classes: ClassChoice = "merged-car",
    split: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="(default: all scenes)")] = None,
    every: Annotated[int, arg(metavar="N")] = 1,
    setting: Annotated[str | None, arg(name="protocol", metavar="NAME", help_behavior_hint="(default: none)")] = None,
    init: Annotated[Path | None, arg(metavar="CHECKPOINT", help_behavior_hint="(default: random weights)")] = None,
    trunk: Annotated[Path | None, arg(metavar="CHECKPOINT", help_behavior_hint="(default: random weights)")] = None,
    pretrained: bool = False,
    seed: int = 0,
    device: str = "auto",
    optimisation: OmitArgPrefixes[Optimisation] = Optimisation(),
    coin3d: OmitArgPrefixes[CoIn3DFlags] = CoIn3DFlags(),
    novel_views: OmitArgPrefixes[NovelViewFlags] = NovelViewFlags(),
) -> None:
    """Train a detector on one or more recordings with labels and LiDAR.

    The folder gets model.safetensors (the checkpoint), run.json (everything needed to repeat the run), log.jsonl and
    curves.png. The same command again continues an interrupted run where it stopped.

    Try:
      coin3d town --out data/train --rig nuscenes --scenes 60
      coin3d train data/train --out runs/coin3d
      coin3d train data/train --out runs/direct --method direct
      coin3d train data/train --out runs/full --gaussians data/train-gaussians
      coin3d train data/train --out runs/petr --detector petr --trunk runs/trunk/model.safetensors
      coin3d train recordings/mine --out runs/mine --init runs/coin3d/model.safetensors --steps 300
      coin3d train data/waymo/training --out runs/waymo --preset paper --protocol waymo-to-nuscenes
      coin3d evaluate runs/coin3d/model.safetensors data/val --out out/score

    Args:
        data: folders of recordings with labels and LiDAR; several are mixed frame by frame.
        out: folder of the run.
        method: none: the plain detector; direct: with its own camera-aware gate; coin3d: spatial-aware modulation.
        preset: tiny: minutes on two CPU cores; small: one modest GPU; paper: the sizes of the paper's tables, several GPUs.
        detector: bevdepth: lifts image features by their depth; bevformer: bird's-eye-view queries look into the images;
            petr: object queries attend to image cells that know where they look.
        classes: which names count as which class (docs/datasets.md).
        split: train on these scenes: a split of nuScenes, Lyft or DDAD (train), or a text file with scene names.
        every: take every n-th frame of each scene; 4 is usual for Waymo, which is labelled ten times a second.
        setting: a comparison of the paper, which sets classes and, for each recording, split and frame rate; with
            --detector bevdepth --preset paper also the input size. coin3d protocols prints them.
        init: start from the weights of this checkpoint (same detector, preset and method), to fine-tune.
        trunk: start the image trunk from this checkpoint of coin3d pretrain (same detector and preset).
        pretrained: start the backbone from ImageNet weights, which are downloaded.
        seed: of weights, data order and augmentation.
        device: auto, cpu, cuda, cuda:1 ...
        optimisation: how long and how fast; what is not given comes from the preset.
        coin3d: only with --method coin3d; the defaults are the paper's method, without novel views unless given Gaussians.
        novel_views: where the Gaussians are, and how rigs are drawn.
    """
    from coin3d.detectors import DETECTORS
    from coin3d.inference import checkpoint_path, resolve_device
    from coin3d.methods import METHODS
    from coin3d.training.loop import LOG_FILE
    from coin3d.training.options import TrainOptions
    from coin3d.training.train import train as run

    if not data:
        raise ValueError("name at least one recording to train on: coin3d train FOLDER --out RUN")
    if method != "coin3d" and coin3d != CoIn3DFlags():
        changed = [name for name, value in vars(coin3d).items() if value != getattr(CoIn3DFlags(), name)]
        raise ValueError(f"--method {method} has no {', '.join(changed)}: these belong to --method coin3d")
    config = replace(getattr(DETECTORS[detector][0], preset)(), pretrained=pretrained)
    options = optimisation.applied_to(getattr(TrainOptions, preset)(), seed)
    method_options: Any = coin3d.options(detector, config.image_width_px) if method == "coin3d" else METHODS[method][0]()
    if (rendered := novel_views.options()) is not None:
        if method == "none":
            raise ValueError("--method none renders no novel views: leave --gaussians out, or take direct or coin3d")
        method_options = replace(method_options, novel_views=rendered)
    chosen = choose_sources(setting, split, every, classes)
    if chosen.protocol is not None and (detector, preset) == ("bevdepth", "paper"):
        width, height = chosen.protocol.input_px
        config = replace(config, image_width_px=width, image_height_px=height)
    began = time.monotonic()
    weights = run(
        data,
        out,
        detector=detector,
        config=config,
        method=method,
        method_options=method_options,
        class_map=chosen.class_map,
        open_with=chosen.open,
        selection=chosen.selection,
        options=options,
        init=None if init is None else checkpoint_path(init),
        trunk=trunk,
        gaussians=novel_views.gaussians,
        device=resolve_device(device),
    )
    last = json.loads((out / LOG_FILE).read_text(encoding="utf-8").splitlines()[-1])
    result = {
        "checkpoint": str(weights),
        "data": [str(path) for path in data],
        "detector": detector,
        "method": method,
        "preset": preset,
        "classes": chosen.class_map.name,
        "selection": chosen.selection,
        "steps": options.steps,
        "seconds": round(time.monotonic() - began, 1),
        "last_losses": last["losses"],
    }
    print(f"weights: {weights}")
    finish(out, result, [out / "curves.png"])
