"""Learning rate and averaged weights, step by step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn

from coin3d.training.ema import WeightAverage
from coin3d.training.options import TrainOptions


def test_cosine_schedule_by_hand() -> None:
    options = TrainOptions(steps=110, warmup_steps=10, learning_rate=2.0, schedule="cosine")
    rate = options.learning_rate_at
    assert rate(0) == pytest.approx(0.002)
    assert rate(5) == pytest.approx(2 * (0.001 + 0.999 / 2))
    assert rate(10) == 2.0
    assert rate(60) == pytest.approx(1.0)
    assert rate(109) == pytest.approx(1 + np.cos(np.pi * 0.99))
    rates = [rate(step) for step in range(110)]
    assert np.argmax(rates) == 10 and min(rates) >= 0


def test_constant_schedule() -> None:
    options = TrainOptions(steps=50, warmup_steps=4, learning_rate=0.5)
    assert [options.learning_rate_at(s) for s in (4, 30, 49)] == [0.5] * 3
    assert replace(options, warmup_steps=0).learning_rate_at(0) == 0.5


def test_a_run_shorter_than_its_warm_up_only_warms_up() -> None:
    options = TrainOptions(steps=3, warmup_steps=10, learning_rate=1.0, schedule="cosine")
    assert [options.learning_rate_at(s) for s in range(3)] == pytest.approx([0.001, 0.1009, 0.2008])


@pytest.mark.parametrize("wrong", [{"steps": 0}, {"batch_size": 0}, {"save_every": 0}, {"ema_decay": 1.0}, {"ema_decay": -0.1}])
def test_nonsense_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"at least 1|lies in \[0, 1\)"):
        replace(TrainOptions(), **wrong)


def test_presets_follow_the_paper_and_fit_their_machine() -> None:
    paper = TrainOptions.paper()
    assert (paper.learning_rate, paper.weight_decay, paper.clip_norm, paper.schedule) == (2e-4, 1e-2, 5.0, "constant")
    assert paper.learning_rate_at(200) == paper.learning_rate_at(20_000) == 2e-4
    assert TrainOptions.tiny().steps < TrainOptions.small().steps < paper.steps


def test_average_by_hand() -> None:
    model = nn.Linear(1, 1, bias=False)
    nn.init.constant_(model.weight, 0.0)
    average = WeightAverage(model, decay=0.8, ramp_steps=2.0)
    nn.init.constant_(model.weight, 1.0)
    average.update(model, 0)
    keep = 0.8 * (1 - np.exp(-0.5))
    assert float(average.weights["weight"]) == pytest.approx(1 - keep)
    nn.init.constant_(model.weight, 3.0)
    average.update(model, 1)
    later = 0.8 * (1 - np.exp(-1.0))
    assert float(average.weights["weight"]) == pytest.approx(later * (1 - keep) + (1 - later) * 3)


def test_average_without_decay_is_the_model() -> None:
    model = nn.Sequential(nn.Conv2d(3, 4, 3), nn.BatchNorm2d(4))
    average = WeightAverage(model, decay=0.0)
    model.train()(torch.randn(2, 3, 8, 8))
    average.update(model, 0)
    assert all(torch.equal(average.weights[name], value) for name, value in model.state_dict().items())
    assert int(average.weights["1.num_batches_tracked"]) == 1


def test_average_is_a_copy() -> None:
    model = nn.Linear(2, 2)
    average = WeightAverage(model, 0.9)
    before = average.weights["weight"].clone()
    nn.init.constant_(model.weight, 7.0)
    assert torch.equal(average.weights["weight"], before)
