"""Rotated overlap and suppression of the released implementation, one box without area among them."""

from __future__ import annotations

import numpy as np
import pytest
from parity_files import fixture

from coin3d import native


@pytest.fixture
def stored() -> dict[str, np.ndarray]:
    return fixture("rotated_nms.npz")


def rectangles(stored: dict[str, np.ndarray]) -> np.ndarray:
    return np.ascontiguousarray(stored["boxes_xylwyaw"], dtype=np.float64)


def test_overlaps(stored: dict[str, np.ndarray]) -> None:
    boxes = rectangles(stored)
    iou = np.zeros((40, len(boxes)))
    native.rotated_iou(boxes[:40].copy(), boxes, iou)
    np.testing.assert_allclose(iou, stored["iou_first40"], atol=2e-6)


def test_boxes_kept(stored: dict[str, np.ndarray]) -> None:
    order = np.argsort(-stored["scores"]).astype(np.int64)
    kept = native.rotated_nms(rectangles(stored), order, float(stored["thr"]))
    np.testing.assert_array_equal(kept, stored["keep"])


def test_limits_before_and_after(stored: dict[str, np.ndarray]) -> None:
    best = np.argsort(-stored["scores"]).astype(np.int64)[:200]
    kept = native.rotated_nms(rectangles(stored), best, float(stored["thr"]))[:50]
    np.testing.assert_array_equal(kept, stored["keep_pre200_post50"])
