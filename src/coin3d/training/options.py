"""What a training run can be told."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from coin3d.augmentation import BevAugmentation, ImageAugmentation
from coin3d.training.samples import AugmentOptions


@dataclass(frozen=True)
class TrainOptions:
    """Optimisation of one run.

    Args:
        steps: optimiser steps.
        batch_size: frames per step.
        optimizer: ``adamw`` for everything, or ``muon`` for the convolutions and AdamW for the rest.
        learning_rate: peak learning rate of AdamW.
        muon_learning_rate: peak learning rate of Muon.
        backbone_rate: share of the learning rates that the image trunk gets, below 1 for trunks that were trained before.
        weight_decay: of AdamW.
        warmup_steps: linear warm-up from a thousandth of the learning rate.
        schedule: after warm-up, fall to zero along a cosine or stay (the released configuration stays).
        clip_norm: gradients are clipped to this L2 norm.
        ema_decay: decay of the averaged weights, which are the ones saved; 0 saves the weights as they are.
        precision: ``bfloat16`` runs the network under autocast; on a CPU it pays only with hardware for it.
        workers: loader processes.
        save_every: steps between resumable checkpoints.
        seed: of weights, data order and augmentation.
        augment: augmentation shared by all methods.
    """

    steps: int = 100_000
    batch_size: int = 8
    optimizer: Literal["adamw", "muon"] = "adamw"
    learning_rate: float = 2e-4
    muon_learning_rate: float = 0.02
    backbone_rate: float = 1.0
    weight_decay: float = 1e-2
    warmup_steps: int = 200
    schedule: Literal["cosine", "constant"] = "constant"
    clip_norm: float = 5.0
    ema_decay: float = 0.999
    precision: Literal["float32", "bfloat16"] = "float32"
    workers: int = 1
    save_every: int = 200
    seed: int = 0
    augment: AugmentOptions = field(default_factory=AugmentOptions)

    def __post_init__(self) -> None:
        if self.steps < 1 or self.batch_size < 1 or self.save_every < 1:
            raise ValueError(f"steps, batch_size and save_every are at least 1, got {self}")
        if not 0 <= self.ema_decay < 1:
            raise ValueError(f"ema_decay lies in [0, 1), got {self.ema_decay}")

    @classmethod
    def paper(cls) -> TrainOptions:
        """AdamW 2e-4, constant, 24 epochs of nuScenes at batch 32 (spec official_code 1.7); needs GPUs."""
        return cls(steps=21_000, batch_size=32)

    @classmethod
    def small(cls) -> TrainOptions:
        """For one modest GPU."""
        return cls(steps=20_000, batch_size=8, schedule="cosine")

    @classmethod
    def tiny(cls) -> TrainOptions:
        """Minutes on two CPU cores (benchmarks/training_step.py; those of whole runs: results/town_transfer).

        Neither images nor the ground plane are mirrored or turned. A mirror hides which way a car faces from features that
        are not told of it; a turn of the image by 5 degrees moves the horizon at the edge of a 352-pixel image by 16 rows,
        which is the difference between 10 m and 100 m; a turn of the ground plane keeps the features from knowing where
        their rays lead. All three are learned around in days, not in minutes.
        """
        return cls(
            steps=1_000,
            batch_size=4,
            optimizer="muon",
            learning_rate=1e-3,
            muon_learning_rate=0.03,
            warmup_steps=100,
            schedule="cosine",
            ema_decay=0.99,
            augment=AugmentOptions(
                image=ImageAugmentation(flip_probability=0.0, max_rotation_deg=0.0),
                bev=BevAugmentation(max_rotation_deg=0.0, min_scale=1.0, max_scale=1.0, flip_probability=0.0),
                cameras_per_sample=3,
                half_turn_probability=0.3,
            ),
        )

    def learning_rate_at(self, step: int) -> float:
        """AdamW's learning rate of a step, counted from 0."""
        return self.learning_rate * self.schedule_at(step)

    def schedule_at(self, step: int) -> float:
        """The share of the peak learning rate that is used in a step, counted from 0."""
        if step < self.warmup_steps:
            return 0.001 + 0.999 * step / self.warmup_steps
        if self.schedule == "constant":
            return 1.0
        progress = (step - self.warmup_steps) / max(1, self.steps - self.warmup_steps)
        return 0.5 * (1 + math.cos(math.pi * progress))
