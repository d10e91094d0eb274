"""Random ground truth and detections of it."""

from __future__ import annotations

import numpy as np

from coin3d.geometry import Boxes3D

CLASSES = ("car", "pedestrian", "two-wheel")


def random_truth(rng: np.random.Generator, num_samples: int, max_objects: int, classes=CLASSES) -> dict[str, Boxes3D]:
    truth = {}
    for sample in range(num_samples):
        n = int(rng.integers(0, max_objects + 1))
        truth[f"sample {sample}"] = Boxes3D.create(
            np.column_stack([rng.uniform(-40, 40, (n, 2)), rng.normal(1, 0.3, n)]),
            rng.uniform(0.4, 5, (n, 3)),
            rng.uniform(-np.pi, np.pi, n),
            rng.choice(classes, n),
        )
    return truth


def random_detections(
    rng: np.random.Generator,
    truth: dict[str, Boxes3D],
    *,
    found: float = 0.7,
    twice: float = 0.2,
    false_per_sample: int = 6,
    score_step: float | None = None,
    noise_m: float = 0.6,
    classes=CLASSES,
) -> dict[str, Boxes3D]:
    """Noisy copies of some objects, some of them twice, plus boxes at random places; scores only loosely tell them apart.

    ``score_step`` rounds the scores, which makes many of them equal.
    """
    predictions = {}
    for token, objects in truth.items():
        copies = [objects[rng.random(len(objects)) < p] for p in (found, twice)]
        m = int(rng.integers(0, false_per_sample + 1))
        centre = np.concatenate([*(c.centre_m for c in copies), np.column_stack([rng.uniform(-45, 45, (m, 2)), np.ones(m)])])
        size = np.concatenate([*(c.size_m for c in copies), rng.uniform(0.4, 5, (m, 3))])
        yaw = np.concatenate([*(c.yaw_rad for c in copies), rng.uniform(-np.pi, np.pi, m)])
        n = len(centre)
        scores = np.clip(rng.beta(2, 2, n) - 0.2 * (np.arange(n) >= n - m), 0, 1)
        if score_step:
            scores = np.round(scores / score_step) * score_step
        order = rng.permutation(n)
        predictions[token] = Boxes3D.create(
            centre + rng.normal(0, noise_m, (n, 3)),
            size * np.exp(rng.normal(0, 0.2, (n, 3))),
            yaw + rng.normal(0, 0.5, n) + np.pi * (rng.random(n) < 0.1),
            np.concatenate([*(c.labels for c in copies), rng.choice(classes, m)]),
            scores=np.minimum(scores, 1),
        )[order]
    return predictions
