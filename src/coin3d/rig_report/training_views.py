"""The cameras that training showed to a network, as network input: those recorded, and what augmentation made of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from coin3d.geometry import Camera, GroundPlane, Rig, fit_width
from coin3d.geometry.image_transform import rotated, zoomed
from coin3d.training.samples import BEHIND_M, HALF_TURN
from coin3d.training.seen_rigs import TrainingRigs

_DRAWS = 60
_RIGS_AUGMENTED = 16


@dataclass(frozen=True, eq=False)
class SeenView:
    """One camera of the network input.

    Args:
        camera: after the image rule and image augmentation.
        ground: of its rig.
        filled: whether all of its image came from a camera or a renderer; zoomed out or turned images have black borders.
    """

    camera: Camera
    ground: GroundPlane
    filled: bool = True

    @property
    def height_m(self) -> float:
        """Above the ground."""
        return float(self.ground.height_m(self.camera.ego_from_cam.translation))


@dataclass(frozen=True, eq=False)
class TrainingViews:
    """What there is to compare with.

    Args:
        recorded: cameras of the training recordings.
        drawn: those again after augmentation: images zoomed to both ends of the range and turned to both sides, cameras of
            rigs drawn from the sampler (60 draws from a fixed seed, so that its ranges are covered up to a few percent), and
            everything turned about where half turns were used. Without augmentation none.
    """

    recorded: tuple[SeenView, ...]
    drawn: tuple[SeenView, ...]

    @property
    def everything(self) -> tuple[SeenView, ...]:
        return self.recorded + self.drawn


def network_view(camera: Camera, ground: GroundPlane, size_px: tuple[int, int]) -> SeenView:
    """A recorded camera as the network sees it."""
    return SeenView(fit_width(camera, *size_px).camera(camera), ground)


def training_views(training: TrainingRigs) -> TrainingViews:
    """All cameras that stand for a training; a function of its argument alone. Augmentation is applied to up to 16 rigs."""
    recorded = [network_view(c, rig.ground, training.size_px) for rig in training.rigs for c in rig.values()]
    chosen = np.unique(np.linspace(0, len(training.rigs) - 1, _RIGS_AUGMENTED).round().astype(int))
    rigs = [training.rigs[i] for i in chosen]
    drawn: list[SeenView] = []
    for rig in rigs:
        upright = list(_zoomed_and_turned(rig, training))
        drawn += upright
        if training.half_turn_probability > 0 and not bool(rig.sees(BEHIND_M)):
            drawn += map(_turned_about, [network_view(c, rig.ground, training.size_px) for c in rig.values()] + upright)
    drawn += _novel(rigs, training)
    return TrainingViews(tuple(recorded), tuple(drawn))


def _zoomed_and_turned(rig: Rig, training: TrainingRigs) -> Iterator[SeenView]:
    ratios = [1.0] if training.focal is None else [1.0, training.focal.min_ratio, training.focal.max_ratio]
    turn_rad = np.deg2rad(training.max_rotation_deg)
    angles = [0.0, -turn_rad, turn_rad] if turn_rad > 0 else [0.0]
    for camera in rig.values():
        fit = fit_width(camera, *training.size_px)
        for ratio in ratios:
            for angle_rad in angles:
                if ratio == 1 and angle_rad == 0:
                    continue
                transform = zoomed(fit, camera, ratio)
                if angle_rad:
                    transform = rotated(transform, angle_rad)
                yield SeenView(transform.camera(camera), rig.ground, ratio >= 1 and angle_rad == 0)


def _turned_about(view: SeenView) -> SeenView:
    camera = view.camera.moved(HALF_TURN @ view.camera.ego_from_cam)
    return SeenView(camera, GroundPlane(HALF_TURN.rotate(view.ground.normal), view.ground.offset_m), view.filled)


def _novel(rigs: list[Rig], training: TrainingRigs) -> list[SeenView]:
    if training.novel_views is None or training.novel_views.probability == 0:
        return []
    rng = np.random.default_rng(0)
    views = []
    for number in range(_DRAWS):
        rig = training.novel_views.sampler.draw(rigs[number % len(rigs)], rng)
        views += [network_view(camera, rig.ground, training.size_px) for camera in rig.values()]
    return views
