"""Set a training run up from names and folders, and run it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from coin3d.datasets.classes import ClassMap
from coin3d.datasets.frame import Recording
from coin3d.datasets.open import open_recording
from coin3d.records import to_plain, write_json
from coin3d.rendering.gaussian_folder import GaussianFolder
from coin3d.training.checkpoint import build_detector, describe, load_trunk, load_weights
from coin3d.training.curves import draw_curves
from coin3d.training.denormals import denormals_flushed
from coin3d.training.loop import LOG_FILE, WEIGHTS_FILE, fit
from coin3d.training.options import TrainOptions
from coin3d.training.run_dir import environment, fingerprint, git_state
from coin3d.training.samples import TrainingSamples
from coin3d.training.seen_rigs import DESCRIPTION_KEY, gather_training_rigs

RUN_FILE = "run.json"


@denormals_flushed()
def train(
    data: Sequence[Path],
    out: Path,
    *,
    detector: str,
    config: Any,
    method: str,
    method_options: Any,
    class_map: ClassMap,
    options: TrainOptions,
    open_with: Callable[[Path], Recording] = open_recording,
    selection: Mapping[str, Any] | None = None,
    init: Path | None = None,
    trunk: Path | None = None,
    gaussians: Path | None = None,
    device: str = "cpu",
    progress: Callable[[str], None] = print,
) -> Path:
    """Train a detector on one or more recordings; returns the path of its weights.

    ``out`` receives run.json (everything needed to repeat the run), log.jsonl, curves.png and model.safetensors. Called
    again on an unfinished ``out`` with the same arguments it continues; on a finished one it does nothing.

    ``open_with`` opens a recording, and ``selection`` tells, as plain data for run.json, what it chooses of one; None: all.

    ``init`` starts from all weights of a checkpoint of the same detector and method, ``trunk`` from the image trunk of one.

    ``gaussians`` is the folder of the recordings' scenes as Gaussians, for methods with novel views. It is needed while
    training only: a checkpoint says that novel views were used, not where they lay.

    Raises:
        FileNotFoundError: a recording, checkpoint or folder of Gaussians that is not there.
        ValueError: ``out`` holds a run with other settings, or data that cannot be trained on. Nothing was written then.
    """
    settings = to_plain(
        {
            "data": [str(p) for p in data],
            "detector": detector,
            "config": config,
            "method": method,
            "options": method_options,
            "classes": class_map.name,
            "training": options,
            "selection": selection,
            "init": str(init) if init else None,
            "trunk": str(trunk) if trunk else None,
            "gaussians": str(gaussians) if gaussians else None,
        }
    )
    torch.manual_seed(options.seed)
    model = build_detector(detector, config, class_map.classes, method, method_options)
    if init is not None:
        load_weights(model, init)
    if trunk is not None:
        load_trunk(model, trunk)
    size = (config.image_width_px, config.image_height_px)
    recordings = [open_with(path) for path in data]
    count = options.steps * options.batch_size
    frame_augmentation = model.method.frame_augmentation(None if gaussians is None else GaussianFolder.open(gaussians))
    if gaussians is not None and frame_augmentation is None:
        raise ValueError(f"the method {method} as it is set renders no novel views: it has no use for {gaussians}")
    view_augmentation = model.method.view_augmentation
    samples = TrainingSamples(
        recordings,
        class_map,
        size,
        options.augment,
        view_augmentation,
        options.seed,
        count,
        frame_augmentation,
        config.frames,
    )
    samples[0]  # data that cannot be trained on should show before anything is written
    rigs = gather_training_rigs(recordings, size, options.augment, view_augmentation, frame_augmentation)
    _claim(out, settings, data)
    if (out / WEIGHTS_FILE).is_file():
        progress(f"{out / WEIGHTS_FILE} is finished; choose an empty folder to train again")
        return out / WEIGHTS_FILE
    notes = f"trained on {', '.join(Path(p).name for p in data)} for {options.steps} steps"
    description = describe(detector, config, class_map.classes, method, method_options, notes)
    description[DESCRIPTION_KEY] = rigs.plain()
    fit(model, samples, options, out, description, device=device, progress=progress)
    draw_curves(out / LOG_FILE, out / "curves.png")
    return out / WEIGHTS_FILE


def _claim(out: Path, settings: Any, data: Sequence[Path]) -> None:
    path = out / RUN_FILE
    if path.is_file():
        before = json.loads(path.read_text(encoding="utf-8"))["settings"]
        differing = [k for k in settings if before.get(k) != settings[k]]
        if differing:
            raise ValueError(f"{out} holds a run with another {', '.join(differing)}; choose an empty folder, or delete it")
        return
    write_json(path, {"settings": settings, "git": git_state(), "data_fingerprint": fingerprint(data), **environment()})
