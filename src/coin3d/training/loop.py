"""The training loop. A run that was interrupted continues from its last checkpoint and ends with the same weights."""

from __future__ import annotations

import io
import json
import pickle
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import torch
from torch.utils.data import DataLoader, Subset

from coin3d.detectors import Batch, Detector, collate
from coin3d.records import write_bytes
from coin3d.training.checkpoint import save_checkpoint
from coin3d.training.ema import WeightAverage
from coin3d.training.optimizers import Optimizers, build_optimizers
from coin3d.training.options import TrainOptions
from coin3d.training.samples import TrainingSamples

STATE_FILE = "last.pt"
WEIGHTS_FILE = "model.safetensors"
LOG_FILE = "log.jsonl"


@dataclass(frozen=True)
class StepLog:
    """One line of ``log.jsonl``: losses, gradient norm, seconds of the step and of waiting for data."""

    step: int
    total: float
    losses: dict[str, float]
    grad_norm: float
    learning_rate: float
    seconds: float
    data_seconds: float


def fit(
    model: Detector,
    samples: TrainingSamples,
    options: TrainOptions,
    out: Path,
    description: dict[str, Any],
    *,
    device: torch.device | str = "cpu",
    progress: Callable[[str], None] = print,
) -> None:
    """Train a detector into ``out``: ``log.jsonl``, ``last.pt`` (resumable state), ``model.safetensors`` at the end.

    Raises:
        ValueError: the state in ``out`` belongs to another model, or a loss stops being finite.
    """
    out.mkdir(parents=True, exist_ok=True)
    model = model.to(device).to(memory_format=torch.channels_last)
    optimizers = build_optimizers(model, options)
    average = WeightAverage(model, options.ema_decay)
    start = _restore(out / STATE_FILE, model, optimizers, average, progress)
    _drop_log_after(out / LOG_FILE, start)
    model.train()
    batches = _batches(samples, options, start)
    began = time.monotonic()
    with (out / LOG_FILE).open("a", encoding="utf-8") as log:
        for step in range(start, options.steps):
            record = _step(model, optimizers, average, batches, options, step, device)
            log.write(json.dumps(record.__dict__) + "\n")
            log.flush()
            done = step + 1
            if done % 20 == 0 or done == options.steps:
                left = (time.monotonic() - began) / (done - start) * (options.steps - done)
                parts = " ".join(f"{k} {v:.2f}" for k, v in record.losses.items())
                progress(f"step {done}/{options.steps}  loss {record.total:.2f} ({parts})  {left / 60:.1f} min left")
            if done % options.save_every == 0 and done < options.steps:
                _save_state(out / STATE_FILE, model, optimizers, average, done)
    save_checkpoint(out / WEIGHTS_FILE, average.weights, description)
    (out / STATE_FILE).unlink(missing_ok=True)


def _step(
    model: Detector,
    optimizers: Optimizers,
    average: WeightAverage,
    batches: Iterator[Batch],
    options: TrainOptions,
    step: int,
    device: torch.device | str,
) -> StepLog:
    began = time.monotonic()
    batch = next(batches).to(device)
    waited = time.monotonic() - began
    torch.manual_seed(options.seed * 1_000_003 + step)  # dropout is a function of the step: resuming changes nothing
    for optimizer, peak_rate in optimizers:
        for group in optimizer.param_groups:
            group["lr"] = peak_rate * group["rate_share"] * options.schedule_at(step)
    kind = torch.device(device).type
    with torch.autocast(kind, dtype=torch.bfloat16, enabled=options.precision == "bfloat16"):
        losses = model.losses(batch)
    total = torch.stack(list(losses.values())).sum()
    if not torch.isfinite(total):
        found = ", ".join(f"{name} {float(value.detach()):g}" for name, value in losses.items())
        raise ValueError(f"step {step}: the loss is not finite ({found}); lower the learning rate")
    for optimizer, _ in optimizers:
        optimizer.zero_grad(set_to_none=True)
    torch.autograd.backward([total])
    norm = torch.nn.utils.clip_grad_norm_(model.parameters(), options.clip_norm)
    if not torch.isfinite(norm):  # stop before the weights, and then the saved state, take it in
        raise ValueError(f"step {step}: the gradient is not finite; lower the learning rate")
    for optimizer, _ in optimizers:
        optimizer.step()
    average.update(model, step)
    seconds = time.monotonic() - began
    return StepLog(
        step,
        round(float(total.detach()), 5),
        {name: round(float(value.detach()), 5) for name, value in losses.items()},
        round(float(norm), 4),
        options.learning_rate_at(step),
        round(seconds, 4),
        round(waited, 4),
    )


def _batches(samples: TrainingSamples, options: TrainOptions, start: int) -> Iterator[Batch]:
    rest = Subset(samples, range(start * options.batch_size, options.steps * options.batch_size))
    loader: DataLoader[Any] = DataLoader(
        rest,
        batch_size=options.batch_size,
        num_workers=options.workers,
        collate_fn=collate,
        worker_init_fn=_one_thread,
        prefetch_factor=4 if options.workers else None,
    )
    try:
        yield from loader
    except ValueError as error:  # a loader process buries it under its traceback
        raise ValueError(str(error).rpartition("ValueError: ")[2].strip()) from error


def _one_thread(worker: int) -> None:
    cv2.setNumThreads(0)
    torch.set_num_threads(1)


def _save_state(path: Path, model: Detector, optimizers: Optimizers, average: WeightAverage, step: int) -> None:
    buffer = io.BytesIO()
    progressed = [optimizer.state_dict() for optimizer, _ in optimizers]
    state = {"model": model.state_dict(), "optimizers": progressed, "average": average.weights, "step": step}
    torch.save(state, buffer)
    write_bytes(path, buffer.getvalue())


def _restore(
    path: Path, model: Detector, optimizers: Optimizers, average: WeightAverage, progress: Callable[[str], None]
) -> int:
    if not path.is_file():
        return 0
    try:
        state = torch.load(path, weights_only=True, map_location="cpu")
    except (RuntimeError, EOFError, OSError, pickle.UnpicklingError) as error:
        raise ValueError(f"{path}: not a complete training state ({error}); delete it to start again") from error
    try:
        model.load_state_dict(state["model"])
    except RuntimeError as error:
        raise ValueError(f"{path}: the state of another detector or method; choose an empty folder. {error}") from error
    for (optimizer, _), progressed in zip(optimizers, state["optimizers"], strict=True):
        optimizer.load_state_dict(progressed)
    average.weights = {k: v.to(average.weights[k].device) for k, v in state["average"].items()}
    progress(f"continuing from step {state['step']}")
    return int(state["step"])


def _drop_log_after(path: Path, step: int) -> None:
    if path.is_file():
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        whole = [line for line in lines if line.endswith("\n")]  # a run that was killed may leave half a line
        write_bytes(path, "".join(line for line in whole if json.loads(line)["step"] < step).encode())
