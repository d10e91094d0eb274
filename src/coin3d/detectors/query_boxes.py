"""Ten numbers per box, as detectors with object queries predict them (spec detectors 2, box coding).

Order: x, y (m), log length, log width, z of the centre of gravity (m), log height, sine and cosine of the yaw, velocity x, y
(m/s). The frame is the one the detector predicts in; yaw is counter-clockwise from its x axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from coin3d.detectors.space_range import SpaceRange, inverse_sigmoid
from coin3d.geometry import Boxes3D

CODE_SIZE = 10
START_OF_SHIFTS = 0.1
"""Share of the usual start of the layer that shifts boxes: queries begin near their reference points."""
HEADING = slice(6, 8)
VELOCITY = slice(8, 10)
PLACE = (0, 1, 4)
_LARGEST_LOG_SIZE = 5.0
_KEPT = SpaceRange((-61.2, -61.2, -10.0), (61.2, 61.2, 10.0))


@dataclass(frozen=True)
class QueryDecodeOptions:
    """How boxes are read off the queries; nothing is suppressed, since matching teaches each object one query.

    Args:
        max_boxes: (query, class) pairs considered per sample.
        min_score: weaker ones are dropped.
        space: boxes whose centre lies outside are dropped.
    """

    max_boxes: int = 300
    min_score: float = 0.0
    space: SpaceRange = _KEPT


def encode_boxes(boxes: Boxes3D) -> Float[Tensor, "n 10"]:
    """The code of each box; an unknown velocity stays NaN."""
    place, size, yaw = boxes.centre_m, np.log(boxes.size_m), boxes.yaw_rad
    columns = [place[:, :2], size[:, :2], place[:, 2:], size[:, 2:], np.sin(yaw)[:, None], np.cos(yaw)[:, None]]
    return torch.from_numpy(np.concatenate([*columns, boxes.velocity_mps], axis=1)).float()


def place_boxes(
    raw: Float[Tensor, "... 10"],
    reference: Float[Tensor, "... 3"],
    space: SpaceRange,
    start: Float[Tensor, "... 10"] | None = None,
) -> Float[Tensor, "... 10"]:
    """Codes from what a regression branch gives: its x, y, z are shifts, in logits, of a reference point within the range.

    Args:
        raw: output of the branch.
        reference: reference points, 0..1.
        space: range of space the boxes may lie in.
        start: codes to which all but the place is a correction.
    """
    x, y, z = space.metres((raw[..., PLACE] + inverse_sigmoid(reference)).sigmoid()).unbind(-1)
    code = raw if start is None else raw + start
    return torch.cat([torch.stack([x, y], dim=-1), code[..., 2:4], z[..., None], code[..., 5:]], dim=-1)


def decode_queries(
    class_logits: Float[Tensor, "b q k"],
    codes: Float[Tensor, "b q 10"],
    classes: Sequence[str],
    options: QueryDecodeOptions,
    *,
    with_velocity: bool = True,
) -> list[Boxes3D]:
    """Boxes of each sample in the frame of the codes, best score first.

    Args:
        class_logits: of the last decoder layer.
        codes: of the last decoder layer, placed.
        classes: names, in the order of the logits.
        options: limits.
        with_velocity: whether the velocity was trained; otherwise it is unknown.
    """
    scores = class_logits.detach().float().sigmoid().flatten(1).cpu()
    low, high = (torch.tensor(corner) for corner in (options.space.low_m, options.space.high_m))
    names, decoded = np.asarray(classes, dtype=np.str_), []
    for score, code in zip(scores, codes.detach().float().cpu(), strict=True):
        best, flat = torch.topk(score, min(options.max_boxes, len(score)))
        row, label = code[flat // len(classes)], flat % len(classes)
        place = row[:, PLACE]
        kept = ((place >= low) & (place <= high)).all(1) & (best >= options.min_score)
        row, label, best, place = row[kept], label[kept], best[kept], place[kept]
        boxes = Boxes3D.create(
            place.numpy(),
            row[:, (2, 3, 5)].clamp(-_LARGEST_LOG_SIZE, _LARGEST_LOG_SIZE).exp().numpy(),
            torch.atan2(row[:, 6], row[:, 7]).numpy(),
            names[label.numpy()],
            scores=best.numpy(),
            velocity_mps=row[:, VELOCITY].numpy() if with_velocity else None,
        )
        decoded.append(boxes)
    return decoded
