"""Rotated overlap and non-maximum suppression seen from above."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from coin3d import native
from coin3d.geometry import Boxes3D


def _rectangles(boxes: Boxes3D) -> Float[np.ndarray, "n 5"]:
    columns = [boxes.centre_m[:, :2], boxes.size_m[:, :2], boxes.yaw_rad[:, None]]
    return np.ascontiguousarray(np.concatenate(columns, axis=1), dtype=np.float64)


def rotated_iou(a: Boxes3D, b: Boxes3D) -> Float[np.ndarray, "n m"]:
    """Intersection over union of every pair, seen from above."""
    iou = np.zeros((len(a), len(b)))
    native.rotated_iou(_rectangles(a), _rectangles(b), iou)
    return iou


def rotated_nms(boxes: Boxes3D, iou_threshold: float) -> Int[np.ndarray, "k"]:
    """Rows kept, best score first: a box goes when it overlaps a better kept one by ``iou_threshold`` or more.

    All boxes compete, whatever their class (as the released one-task heads do).
    """
    order = np.argsort(-boxes.scores, kind="stable").astype(np.int64)
    return np.asarray(native.rotated_nms(_rectangles(boxes), order, iou_threshold), dtype=np.int64)
