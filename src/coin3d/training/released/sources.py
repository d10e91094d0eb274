"""Released weights that can be converted: one entry per file, with the detector, method and classes they belong to."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import torch
from torch import Tensor

from coin3d.datasets.classes import CAR, PEDESTRIAN, TWO_WHEEL
from coin3d.detectors.bevdepth_config import BEVDepthConfig
from coin3d.detectors.bevformer_config import BEVFormerConfig
from coin3d.detectors.petr_config import PETRConfig
from coin3d.methods import NoOptions
from coin3d.priors.released import ReleasedConventions
from coin3d.training.checkpoint import build_detector, describe
from coin3d.training.released.bevformer_keys import BEVFORMER_KEYS, bevformer_in_our_coding
from coin3d.training.released.coin3d_keys import COIN3D_KEYS, released_config, released_options
from coin3d.training.released.key_map import KeyMap
from coin3d.training.released.megvii_keys import MEGVII_KEYS, megvii_options
from coin3d.training.released.petr_keys import PETR_KEYS, petr_in_our_conventions


@dataclass(frozen=True)
class Source:
    """One released file, or several alike.

    Args:
        name: what ``coin3d convert --from`` calls it.
        title: what it is, for people.
        notes: what is known of its training; goes into the checkpoint.
        detector: name of the detector the weights are for.
        config: its configuration.
        classes: in the order of the scores.
        keys: names of the weights.
        rearrange: what the numbers need once they have our names.
        method: name of the method of transfer.
        options: its options.
    """

    name: str
    title: str
    notes: str
    detector: str
    config: Any
    classes: tuple[str, ...]
    keys: KeyMap
    rearrange: Callable[[Mapping[str, Tensor]], dict[str, Tensor]] = dict
    method: str = "none"
    options: Any = field(default_factory=NoOptions)

    def own_state(self) -> dict[str, Tensor]:
        """Names, shapes and number formats of the detector, without memory for the numbers."""
        with torch.device("meta"):
            return build_detector(self.detector, self.config, self.classes, self.method, self.options).state_dict()

    def convert(self, released: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """The detector's state.

        Raises:
            ValueError: a weight that is unknown, missing or of another shape, or copies that differ, by name.
        """
        return self.rearrange(self.keys.convert(released, self.own_state()))

    def description(self) -> dict[str, Any]:
        """What a checkpoint needs beside the weights."""
        return describe(self.detector, self.config, self.classes, self.method, self.options, self.notes)

    def knows(self, released: Mapping[str, Tensor]) -> bool:
        """Whether all names of a file are names of this source."""
        try:
            self.keys.unused(released)
        except ValueError:
            return False
        return True

    def fits(self, released: Mapping[str, Tensor]) -> bool:
        """Whether names and shapes of a file are completely those of this source."""
        own = self.own_state()
        named = {self.keys.name(key): tensor.shape for key, tensor in released.items()}
        shapes = {name: tensor.shape for name, tensor in own.items() if name in named or "num_batches_tracked" not in name}
        return {name: shape for name, shape in named.items() if name is not None} == shapes


def source_named(name: str) -> Source:
    """The source with that name.

    Raises:
        ValueError: there is none; the names are listed.
    """
    for source in SOURCES:
        if source.name == name:
            return source
    raise ValueError(f"no released weights are called '{name}'; there are {', '.join(s.name for s in SOURCES)}")


def recognised(released: Mapping[str, Tensor]) -> Source:
    """The only source whose names and shapes are those of a file.

    Raises:
        ValueError: none is, or several are.
    """
    known = [source for source in SOURCES if source.knows(released)]
    fitting = [source for source in known if source.fits(released)]
    if len(fitting) == 1:
        return fitting[0]
    if not known:
        raise ValueError(
            f"weights named like '{next(iter(released))}' are of no network that can be converted; there are "
            f"{', '.join(s.name for s in SOURCES)}; name one with --from to hear what is in the way"
        )
    alike, what = (fitting, "names and shapes") if fitting else (known, "names, though not the shapes,")
    choice = "; ".join(f"{s.name}: {s.title}" for s in alike)
    raise ValueError(f"the {what} of these weights are those of {len(alike)}, say with --from which it is: {choice}")


_TEN_CLASSES = (
    "car", "truck", "construction_vehicle", "bus", "trailer", "barrier", "motorcycle", "bicycle", "pedestrian", "traffic_cone",
)  # fmt: skip


def _coin3d(data: str, title: str, height_px: int, classes: tuple[str, ...] = (CAR,)) -> Source:
    # weights of one data set know the ray's moment in mixed frames, those of the mix as in the paper
    conventions = ReleasedConventions(moment="cam_in_ego" if data == "mix" else "ego_in_cam")
    return Source(
        name=f"coin3d-{data}",
        title=f"CoIn3D (BEVDepth) of its authors, {data}.pth",
        notes=f"trained on {title} for 24 epochs by the authors of CoIn3D; converted",
        detector="bevdepth",
        config=released_config(conventions, height_px, (1.0, 0.7, 0.7)[: len(classes)]),
        classes=classes,
        keys=COIN3D_KEYS,
        method="coin3d",
        options=released_options(conventions),
    )


_BEVFORMER = Source(
    name="bevformer-tiny",
    title="BEVFormer-tiny of its authors, bevformer_tiny_epoch_24.pth and its fp16 twin",
    notes="trained on nuScenes for 24 epochs by the authors of BEVFormer; converted",
    detector="bevformer",
    config=BEVFormerConfig.released_nuscenes(),
    classes=_TEN_CLASSES,
    keys=BEVFORMER_KEYS,
    rearrange=bevformer_in_our_coding,
)
_PETR = Source(
    name="petr-vov",
    title="PETR with V2-99 of its authors, PETR-vov-p4-800x320",
    notes="trained on nuScenes for 24 epochs by the authors of PETR; converted",
    detector="petr",
    config=PETRConfig.released_nuscenes(),
    classes=_TEN_CLASSES,
    keys=PETR_KEYS,
    rearrange=partial(petr_in_our_conventions, sizes="width-length"),
)
_PETR_PORT = Source(
    name="petr-vov-mmdet3d",
    title="PETR with V2-99 as mmdet3d ships it, petr_vovnet_gridmask_p4_800x320-e2191752.pth",
    notes="trained on nuScenes for 24 epochs by the authors of mmdet3d; converted",
    detector="petr",
    config=PETRConfig.released_nuscenes(),
    classes=_TEN_CLASSES,
    keys=PETR_KEYS,
    rearrange=partial(petr_in_our_conventions, sizes="length-width"),
)


def _megvii(name: str, file: str, depth_aggregation: bool) -> Source:
    config = BEVDepthConfig.released_megvii(2, depth_aggregation)
    assert config.megvii is not None
    return Source(
        name=name,
        title=f"BEVDepth of Megvii with two key frames, {file} and its averaged (ema) twin",
        notes="trained on nuScenes by the authors of BEVDepth; converted",
        detector="bevdepth",
        config=config,
        classes=config.megvii.classes,
        keys=MEGVII_KEYS,
        method="direct",
        options=megvii_options(),
    )


SOURCES = (
    _coin3d("nuscenes", "nuScenes", 384),
    _coin3d("lyft", "Lyft", 384),
    _coin3d("waymo", "Waymo", 320),
    _coin3d("mix", "nuScenes, Lyft and Waymo", 320, (CAR, PEDESTRIAN, TWO_WHEEL)),
    _BEVFORMER,
    _PETR,
    _PETR_PORT,
    _megvii("megvii-2key", "bev_depth_lss_r50_256x704_128x128_24e_2key.pth", depth_aggregation=False),
    _megvii("megvii-2key-da", "bev_depth_lss_r50_256x704_128x128_20e_cbgs_2key_da.pth", depth_aggregation=True),
)
"""Adding one is adding an entry here (and a row in docs/convert.md)."""
