"""Novel-view augmentation (paper CDA): a frame's Gaussians, rendered through a rig drawn at random."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from coin3d.augmentation.rig_sampler import RigSampler
from coin3d.augmentation.view import View
from coin3d.datasets.frame import Frame
from coin3d.geometry import Camera, ImageTransform, Rig, fit_width
from coin3d.rendering import Gaussians, Rendering, render
from coin3d.rendering.gaussian_folder import GaussianFolder

Render = Callable[[Gaussians, Sequence[Camera]], Sequence[Rendering]]


@dataclass(frozen=True)
class NovelViewOptions:
    """When a sample is rendered, and through which rigs. Where the Gaussians lie is told when training starts.

    Args:
        probability: chance of a sample to be rendered; otherwise its raw images are used (paper: 0.5).
        sampler: draws the rigs.
        min_covered: a view of which the Gaussians cover less than this share is left out: it looks where no source camera
            looked, and its black pixels would be trained on as if nothing stood there.
    """

    probability: float = 0.5
    sampler: RigSampler = field(default_factory=RigSampler)
    min_covered: float = 0.25

    def __post_init__(self) -> None:
        if not 0 <= self.probability <= 1 or not 0 <= self.min_covered <= 1:
            raise ValueError(f"probability and min_covered lie in [0, 1], got {self.probability} and {self.min_covered}")


@dataclass(frozen=True)
class NovelViews:
    """Frame augmentation: the views of a sample, rendered at the size of the network input, or None to keep the raw ones.

    One rig is drawn for the whole frame, from its cameras where they were when they fired; only the cameras of the sample
    are rendered. If the array itself was changed, as many of the new cameras are chosen at random as the sample may have.

    Args:
        options: when, and through which rigs.
        folder: the Gaussians. Frames without are left raw.
        render: renderer; on the loader's one thread by default.
    """

    options: NovelViewOptions
    folder: GaussianFolder
    render: Render = render

    def __call__(
        self, frame: Frame, names: Sequence[str], size_px: tuple[int, int], rng: np.random.Generator
    ) -> list[View] | None:
        if rng.random() >= self.options.probability:
            return None
        gaussians = self.folder.load(frame.scene, frame.token)
        if gaussians is None:
            return None
        rig = self.options.sampler.draw(frame.rig, rng)
        sources = [rig[name] for name in self._chosen(frame, rig, names, rng)]
        fits = [fit_width(camera, *size_px) for camera in sources]
        cameras = [fit.camera(camera) for fit, camera in zip(fits, sources, strict=True)]
        renderings = self.render(gaussians, cameras)
        views = []
        for fit, camera, rendering in zip(fits, cameras, renderings, strict=True):
            padding = max(0, round(fit.affine[1, 2]))  # rows above the image are black in raw views, so they are here
            alpha = rendering.alpha[padding:]
            if alpha.size and float((alpha > 0.5).mean()) >= self.options.min_covered:
                views.append(_view(rendering, camera, padding))
        return views or None

    def _chosen(self, frame: Frame, rig: Rig, names: Sequence[str], rng: np.random.Generator) -> list[str]:
        if list(rig) == list(frame.rig):
            return list(names)
        drawn = list(rig)
        if len(names) == len(frame.rig) or len(names) >= len(drawn):
            return drawn
        return [drawn[i] for i in sorted(rng.choice(len(drawn), len(names), replace=False))]


def novel_views(options: NovelViewOptions | None, folder: GaussianFolder | None) -> NovelViews | None:
    """The augmentation a method with these options has, None without options.

    Raises:
        ValueError: options, but no Gaussians to render.
    """
    if options is None:
        return None
    if folder is None:
        raise ValueError("novel views are rendered from Gaussians: say where they are (--gaussians), or switch novel views off")
    return NovelViews(options, folder)


def _view(rendering: Rendering, camera: Camera, padding: int) -> View:
    image = rendering.rgb
    if padding:
        image = image.copy()
        image[:padding] = 0
    whole = ImageTransform((camera.width_px, camera.height_px), np.eye(3), camera.width_px, camera.height_px)
    return View(image, camera, whole)
