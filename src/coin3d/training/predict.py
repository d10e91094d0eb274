"""Run a detector over a recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import torch

from coin3d.datasets.classes import ClassMap
from coin3d.datasets.frame import Frame, Recording
from coin3d.datasets.frames_before import FramesBefore
from coin3d.detectors import Detector, collate, frame_sample
from coin3d.evaluation import Protocol, Report, annotated_boxes, score
from coin3d.geometry import Boxes3D

Precision = Literal["float32", "bfloat16"]


@torch.no_grad()
def predict(
    model: Detector,
    frames: Sequence[Frame],
    *,
    recording: Recording | None = None,
    precision: Precision = "float32",
    device: torch.device | str = "cpu",
    progress: Callable[[str], None] | None = None,
) -> dict[str, Boxes3D]:
    """Detect in each frame.

    Args:
        model: a detector; it is put into evaluation mode.
        frames: where to detect.
        recording: where detectors that look back find the frames before; by default among ``frames``.
        precision: number format of the network; geometry and boxes stay in float32.
        device: where the detector runs.
        progress: told every 20 frames.

    Returns:
        token -> boxes in the ego frame at the reference time.
    """
    model = model.to(device).eval()
    config, found = model.config, {}
    before = FramesBefore(frames if recording is None else recording)
    for i, frame in enumerate(frames):
        earlier = before(frame, config.frames - 1, i if recording is None else None)
        batch = collate([frame_sample(frame, config.image_width_px, config.image_height_px, earlier)]).to(device)
        with torch.autocast(torch.device(device).type, dtype=torch.bfloat16, enabled=precision == "bfloat16"):
            found[frame.token] = model.detect(batch)[0]
        if progress is not None and ((i + 1) % 20 == 0 or i + 1 == len(frames)):
            progress(f"detected in {i + 1} of {len(frames)} frames")
    return found


def score_frames(frames: Sequence[Frame], predictions: dict[str, Boxes3D], class_map: ClassMap, protocol: Protocol) -> Report:
    """Score predictions against the annotations of the frames, both with the classes of the map.

    Raises:
        ValueError: a frame without annotations.
    """
    found = {token: class_map.apply(boxes) for token, boxes in predictions.items()}
    return score(annotated_boxes(frames, class_map), found, {frame.token: frame.rig for frame in frames}, protocol)
