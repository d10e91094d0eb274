"""Correct the colours of the Gaussians for the blur of splatting them.

A splat covers its neighbours' pixels too, so an image rendered from its own pixels is a blurred one. Adding what is
missing to each pixel's own Gaussian, a few times, undoes that (a Jacobi iteration on colours, no training).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coin3d.rendering import Gaussians, render
from coin3d.scenes.assemble import ViewGaussians
from coin3d.scenes.seen_view import SeenView


def sharpened(gaussians: Gaussians, parts: Sequence[ViewGaussians], views: Sequence[SeenView], rounds: int) -> Gaussians:
    """The same Gaussians, whose renderings through ``views`` are closer to the images.

    Args:
        gaussians: begins with the ``seen`` Gaussians of all parts, in order.
        parts: what each view contributed.
        views: the images.
        rounds: 0 leaves everything as it is.
    """
    starts = np.cumsum([0, *(len(part.seen) for part in parts)])
    colour = gaussians.rgb.astype(np.float32)
    for _ in range(rounds):
        now = Gaussians(gaussians.centre_m, gaussians.std_m, colour.round().astype(np.uint8))
        for part, view, start, image in zip(parts, views, starts, render(now, [v.camera for v in views]), strict=False):
            missing = view.rgb.astype(np.float32) - image.rgb
            rows = slice(start, start + len(part.seen))
            colour[rows] = np.clip(colour[rows] + missing.reshape(-1, 3)[part.pixel], 0, 255)
    return Gaussians(gaussians.centre_m, gaussians.std_m, colour.round().astype(np.uint8))
