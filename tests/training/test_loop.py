"""The training loop: reproducible, resumable to the bit, and it stops when something goes wrong."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

from coin3d.datasets.classes import ClassMap
from coin3d.detectors import BEVDepth, Sample
from coin3d.methods import METHODS
from coin3d.training.checkpoint import describe, load_checkpoint
from coin3d.training.loop import LOG_FILE, STATE_FILE, WEIGHTS_FILE, fit
from coin3d.training.options import TrainOptions
from coin3d.training.samples import AugmentOptions, TrainingSamples
from small_world import CLASSES, CONFIG, SIZE_PX, MemoryRecording, detector, frame, ring_rig

BOTH = ClassMap("both", {"car": "car", "pedestrian": "pedestrian"})
OPTIONS = TrainOptions(
    steps=6,
    batch_size=2,
    optimizer="muon",
    learning_rate=1e-3,
    warmup_steps=2,
    schedule="cosine",
    ema_decay=0.9,
    workers=0,
    save_every=3,
)


class KilledError(Exception):
    pass


class DyingSamples(TrainingSamples):
    """Samples that take the process with them at some number."""

    last = 10**9

    def __getitem__(self, number: int) -> Sample:
        if number > self.last:
            raise KilledError
        return super().__getitem__(number)


def samples(model: BEVDepth, options: TrainOptions, last: int = 10**9) -> TrainingSamples:
    frames = [frame(i, ring_rig(2)) for i in range(3)]
    view, count = model.method.view_augmentation, options.steps * options.batch_size
    made = DyingSamples([MemoryRecording(frames)], BOTH, SIZE_PX, AugmentOptions(), view, options.seed, count)
    made.last = last
    return made


def train(
    out: Path, options: TrainOptions = OPTIONS, *, method: str = "coin3d", init_seed: int = 0, last: int = 10**9
) -> bytes:
    """One run from its own weights; returns the bytes of the checkpoint."""
    model = detector(method, seed=init_seed)
    description = describe("bevdepth", CONFIG, CLASSES, method, METHODS[method][0]())
    fit(model, samples(model, options, last), options, out, description, progress=lambda line: None)
    return (out / WEIGHTS_FILE).read_bytes()


def log(out: Path) -> list[dict[str, float]]:
    return [json.loads(line) for line in (out / LOG_FILE).read_text().splitlines()]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of six steps that nothing interrupted."""
    out = tmp_path_factory.mktemp("whole")
    train(out)
    return out


def test_a_killed_run_continues_to_the_same_bits(whole: Path, tmp_path: Path) -> None:
    with pytest.raises(KilledError):
        train(tmp_path, last=9)  # dies in step 4, after the state of step 3 was saved
    assert (tmp_path / STATE_FILE).is_file() and not (tmp_path / WEIGHTS_FILE).exists()
    assert [row["step"] for row in log(tmp_path)] == [0, 1, 2, 3, 4]
    with (tmp_path / LOG_FILE).open("a") as file:
        file.write('{"step": 5, "tot')  # killed while writing
    torch.rand(7)  # the state of the global generator means nothing
    resumed = train(tmp_path, init_seed=99)  # fresh weights are replaced by the saved ones
    assert resumed == (whole / WEIGHTS_FILE).read_bytes()
    assert [row["step"] for row in log(tmp_path)] == [0, 1, 2, 3, 4, 5]
    assert [row["total"] for row in log(tmp_path)] == [row["total"] for row in log(whole)]
    assert not (tmp_path / STATE_FILE).exists()


def test_same_seed_same_weights_whatever_the_workers(whole: Path, tmp_path: Path) -> None:
    assert train(tmp_path, replace(OPTIONS, workers=1)) == (whole / WEIGHTS_FILE).read_bytes()


def test_another_seed_gives_other_weights(whole: Path, tmp_path: Path) -> None:
    assert train(tmp_path, replace(OPTIONS, seed=1)) != (whole / WEIGHTS_FILE).read_bytes()


def test_the_log_tells_each_step(whole: Path) -> None:
    rows = log(whole)
    assert [row["step"] for row in rows] == list(range(6))
    for row in rows:
        assert row["total"] == pytest.approx(sum(row["losses"].values()), abs=1e-4)
        assert row["learning_rate"] == OPTIONS.learning_rate_at(row["step"])
        assert 0 <= row["data_seconds"] <= row["seconds"] and row["grad_norm"] > 0
    assert list(whole.glob("*.part")) == []


def test_the_average_is_what_is_saved(tmp_path: Path) -> None:
    """Without an average the checkpoint holds the weights of the last step."""
    options = replace(OPTIONS, steps=2, ema_decay=0.0)
    model = detector("none")
    fit(model, samples(model, options), options, tmp_path, {}, progress=lambda line: None)
    saved = load_file(tmp_path / WEIGHTS_FILE)
    for name, value in model.state_dict().items():
        assert torch.equal(saved[name], value), name
    averaged = tmp_path / "averaged"
    fit(detector("none"), samples(model, options), replace(options, ema_decay=0.9), averaged, {}, progress=lambda line: None)
    assert not torch.equal(load_file(averaged / WEIGHTS_FILE)["head.shared_conv.0.weight"], saved["head.shared_conv.0.weight"])


def test_the_checkpoint_detects(whole: Path) -> None:
    model, description = load_checkpoint(whole / WEIGHTS_FILE)
    assert description["method"] == "coin3d" and not model.training


def test_bfloat16_trains(tmp_path: Path) -> None:
    train(tmp_path, replace(OPTIONS, steps=2, precision="bfloat16"))
    assert {t.dtype for t in load_file(tmp_path / WEIGHTS_FILE).values()} == {torch.float32, torch.int64}


def test_a_loss_that_is_not_finite_stops_the_run(tmp_path: Path) -> None:
    model = detector("none")
    torch.nn.init.constant_(model.head.branches["height"][1].bias, torch.nan)
    with pytest.raises(ValueError, match=r"step 0: the loss is not finite \(.*height nan.*lower the learning rate"):
        fit(model, samples(model, OPTIONS), OPTIONS, tmp_path, {}, progress=lambda line: None)
    assert not (tmp_path / WEIGHTS_FILE).exists()


def test_a_gradient_that_is_not_finite_stops_the_run(tmp_path: Path) -> None:
    model = detector("none")
    model.neck.out_conv.weight.register_hook(lambda grad: grad * torch.inf)
    with pytest.raises(ValueError, match="step 0: the gradient is not finite"):
        fit(model, samples(model, OPTIONS), OPTIONS, tmp_path, {}, progress=lambda line: None)
    assert all(p.isfinite().all() for p in model.parameters())


def test_the_state_of_another_method_is_refused(tmp_path: Path) -> None:
    with pytest.raises(KilledError):
        train(tmp_path, last=9)
    with pytest.raises(ValueError, match=r"last\.pt: the state of another detector or method"):
        train(tmp_path, method="direct")


def test_a_damaged_state_is_named(tmp_path: Path) -> None:
    with pytest.raises(KilledError):
        train(tmp_path, last=9)
    state = tmp_path / STATE_FILE
    state.write_bytes(state.read_bytes()[:5000])
    with pytest.raises(ValueError, match=r"last\.pt: not a complete training state .* delete it"):
        train(tmp_path)


def test_progress_is_told(tmp_path: Path) -> None:
    lines: list[str] = []
    model = detector("none")
    options = replace(OPTIONS, steps=1)
    fit(model, samples(model, options), options, tmp_path, {}, progress=lines.append)
    assert len(lines) == 1 and lines[0].startswith("step 1/1  loss ") and "min left" in lines[0]


@pytest.mark.parametrize("workers", [0, 1])
def test_a_frame_that_cannot_be_read_is_named_in_one_line(workers: int, tmp_path: Path) -> None:
    model, options = detector("none"), replace(OPTIONS, workers=workers)
    frames = [frame(0, ring_rig(2)), replace(frame(1, ring_rig(2)), lidar=None)]
    broken = TrainingSamples([MemoryRecording(frames)], BOTH, SIZE_PX, AugmentOptions(), None, 0, 12)
    with pytest.raises(ValueError, match=r"^frame frame1 has no LiDAR; training needs it for depth supervision$"):
        fit(model, broken, options, tmp_path, {}, progress=lambda line: None)
