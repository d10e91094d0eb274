"""The rigs that a network was trained through: gathered when training starts, kept with its weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from coin3d.augmentation import FocalAugmentation, FrameAugmentation, NovelViewOptions, ViewAugmentation
from coin3d.augmentation.novel_view import NovelViews
from coin3d.datasets.frame import Recording
from coin3d.geometry import Rig
from coin3d.geometry.rig_file import rig_from_dict, rig_to_dict
from coin3d.geometry.undistort import undistorted_rig
from coin3d.methods import METHODS
from coin3d.records import from_plain, to_plain
from coin3d.training.samples import AugmentOptions

DESCRIPTION_KEY = "training_rigs"
"""Under which a checkpoint's description holds them."""

FRAMES_LOOKED_AT = 100
"""Rigs are those of so many frames of each recording, evenly spread."""

_MOST_RIGS = 64
_DECIMALS = 6
_LONGEST_PX = 16_384
# two rigs count as one if every camera agrees within these: focal length, principal point (of the width), place, direction
_FOCAL_SHARE, _CENTRE_SHARE, _PLACE_M, _ANGLE_RAD = 0.01, 0.005, 0.1, np.deg2rad(0.5)


@dataclass(frozen=True, eq=False)
class TrainingRigs:
    """Through which cameras a network saw its training frames.

    Args:
        rigs: distinct rigs as recorded, before the image rule, with pinhole cameras in place of those with lenses.
            Frames whose cameras differ by less than about 0.1 m, 0.5 degrees and 1 % of the focal length share one (more where
            there would be too many).
        size_px: (width, height) of the network input.
        focal: zoom of raw images, or None.
        novel_views: ranges from which rigs were drawn for rendered views, and how often; None without such views.
        max_rotation_deg: images were turned within plus or minus this.
        half_turn_probability: chance that a sample of a rig that does not see behind was told with everything turned about.

    Raises:
        ValueError: no rigs, an input without pixels, or an angle or probability that is none.
    """

    rigs: tuple[Rig, ...]
    size_px: tuple[int, int]
    focal: FocalAugmentation | None = None
    novel_views: NovelViewOptions | None = None
    max_rotation_deg: float = 0.0
    half_turn_probability: float = 0.0

    def __post_init__(self) -> None:
        if not self.rigs:
            raise ValueError("there are no training rigs")
        object.__setattr__(self, "rigs", tuple(map(undistorted_rig, self.rigs)))
        if min(self.size_px) < 1 or max(self.size_px) > _LONGEST_PX:
            raise ValueError(f"a network input has from 1 to {_LONGEST_PX} pixels a side, got {self.size_px}")
        if not 0 <= self.max_rotation_deg <= 180 or not 0 <= self.half_turn_probability <= 1:
            numbers = f"{self.max_rotation_deg} and {self.half_turn_probability}"
            raise ValueError(f"images turn by 0 to 180 degrees, half turns have a probability in [0, 1], got {numbers}")

    def plain(self) -> dict[str, Any]:
        """As JSON can hold it; numbers of rigs with six decimals."""
        return {
            "rigs": [_rounded(rig_to_dict(rig)) for rig in self.rigs],
            "size_px": list(self.size_px),
            "focal": to_plain(self.focal),
            "novel_views": to_plain(self.novel_views),
            "max_rotation_deg": self.max_rotation_deg,
            "half_turn_probability": self.half_turn_probability,
        }

    @classmethod
    def from_plain(cls, data: Any) -> TrainingRigs:
        """The inverse of ``plain``.

        Raises:
            ValueError: a field that is missing, unknown, or makes no sense.
        """
        fields = from_plain(_Plain, data, DESCRIPTION_KEY)
        if not isinstance(fields.rigs, list) or len(fields.rigs) > _MOST_RIGS:
            raise ValueError(f"{DESCRIPTION_KEY}.rigs is a list of up to {_MOST_RIGS} rigs")
        rigs = tuple(rig_from_dict(rig) for rig in fields.rigs)
        return cls(
            rigs,
            fields.size_px,
            fields.focal,
            fields.novel_views,
            fields.max_rotation_deg,
            fields.half_turn_probability,
        )


def gather_training_rigs(
    recordings: Sequence[Recording],
    size_px: tuple[int, int],
    augment: AugmentOptions,
    view_augmentation: ViewAugmentation | None = None,
    frame_augmentation: FrameAugmentation | None = None,
) -> TrainingRigs:
    """The distinct rigs of recordings, and what augmentation makes of them; arguments as ``TrainingSamples`` has them.

    Raises:
        ValueError: there are no frames, or one cannot be read.
    """
    rigs = []
    for recording in recordings:
        count = min(len(recording), FRAMES_LOOKED_AT)
        rigs += [recording[int(i)].rig for i in np.linspace(0, len(recording) - 1, count).round()]
    return TrainingRigs(
        distinct_rigs(list(map(undistorted_rig, rigs))),
        size_px,
        view_augmentation if isinstance(view_augmentation, FocalAugmentation) else None,
        frame_augmentation.options if isinstance(frame_augmentation, NovelViews) else None,
        augment.image.max_rotation_deg,
        augment.half_turn_probability,
    )


def distinct_rigs(rigs: Sequence[Rig], most: int = _MOST_RIGS) -> tuple[Rig, ...]:
    """Rigs of which no two are alike, first come first kept; what counts as alike widens until at most ``most`` are left."""
    kinds = [tuple((name, camera.width_px, camera.height_px) for name, camera in rig.items()) for rig in rigs]
    numbers = [_in_tolerances(rig) for rig in rigs]
    most, tolerance = max(most, len(set(kinds))), 1.0
    while True:
        kept: list[int] = []
        for i, mine in enumerate(numbers):
            if not any(kinds[k] == kinds[i] and np.abs(mine - numbers[k]).max() <= tolerance for k in kept):
                kept.append(i)
        if len(kept) <= most:
            return tuple(rigs[i] for i in kept)
        tolerance *= 2


def rigs_of_description(description: dict[str, Any], where: str) -> TrainingRigs | None:
    """What a checkpoint's description says of its training rigs; None if it does not say.

    Args:
        description: of the checkpoint.
        where: its file, for errors.

    Raises:
        ValueError: it says what makes no sense.
    """
    if DESCRIPTION_KEY not in description:
        return None
    try:
        return TrainingRigs.from_plain(description[DESCRIPTION_KEY])
    except ValueError as error:
        raise ValueError(f"{where}: the training rigs in the checkpoint are damaged: {error}") from error


def named_rigs(rigs: Sequence[Rig], description: dict[str, Any], where: str) -> TrainingRigs:
    """For a checkpoint that does not know its rigs: rigs that someone names, with the augmentation that its method tells of.

    How images were turned, and whether samples were turned about, is not known then and left out.

    Args:
        rigs: of pinhole cameras.
        description: of the checkpoint.
        where: its file, for errors.

    Raises:
        ValueError: an unknown method, options that are not its own, or no size of the network input.
    """
    if description["method"] not in METHODS:
        raise ValueError(f"{where}: made with the method '{description['method']}', known are {', '.join(METHODS)}")
    kind, make = METHODS[description["method"]]
    try:
        options: Any = from_plain(kind, description["options"])
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error
    zoom, novel = make(options).view_augmentation, getattr(options, "novel_views", None)
    return TrainingRigs(
        tuple(rigs),
        _input_size_px(description, where),
        zoom if isinstance(zoom, FocalAugmentation) else None,
        novel if isinstance(novel, NovelViewOptions) else None,
    )


def _input_size_px(description: dict[str, Any], where: str) -> tuple[int, int]:
    config = description.get("config")
    width, height = (config.get(f"image_{side}_px") for side in ("width", "height")) if isinstance(config, dict) else (0, 0)
    if not (isinstance(width, int) and isinstance(height, int) and min(width, height) > 0):
        raise ValueError(f"{where}: the checkpoint does not say the size of its network input")
    return width, height


@dataclass(frozen=True)
class _Plain:
    """``TrainingRigs`` before its rigs are read."""

    rigs: Any = None
    size_px: tuple[int, int] = (0, 0)
    focal: FocalAugmentation | None = None
    novel_views: NovelViewOptions | None = None
    max_rotation_deg: float = 0.0
    half_turn_probability: float = 0.0


def _in_tolerances(rig: Rig) -> Float[np.ndarray, "n"]:
    """All numbers of a rig, each in units of what still counts as alike."""
    parts = [rig.ground.normal / _ANGLE_RAD, [rig.ground.offset_m / _PLACE_M]]
    for camera in rig.values():
        parts.append([np.log(camera.focal_px) / _FOCAL_SHARE])
        parts.append(camera.K[:2, 2] / (_CENTRE_SHARE * camera.width_px))
        parts.append(camera.ego_from_cam.translation / _PLACE_M)
        parts.append(camera.ego_from_cam.rotation.ravel() / _ANGLE_RAD)
    return np.concatenate(parts)


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, _DECIMALS)
    if isinstance(value, dict):
        return {key: _rounded(v) for key, v in value.items()}
    return [_rounded(v) for v in value] if isinstance(value, list) else value
