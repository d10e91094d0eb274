"""Boxes on the textured point cloud of a frame, seen from above and behind (paper figure gt_pred_cmp)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import UInt8

from coin3d.drawing.colours import PREDICTION, TRUTH
from coin3d.drawing.pictures import draw_boxes
from coin3d.drawing.sheet import Panel, sheet
from coin3d.geometry import Boxes3D, Camera, camera_pose
from coin3d.rendering import Gaussians, render

_BACK_M, _UP_M, _DOWN_DEG, _WIDE_DEG = 20.0, 14.0, 24.0, 62.0
_CEILING_M = 6.0
_MIN_STD_M, _STD_PER_M = 0.03, 0.003


def overview_camera(width_px: int, height_px: int) -> Camera:
    """A camera behind and above the vehicle that looks ahead and down, pinhole, in the ego frame."""
    focal_px = width_px / 2 / np.tan(np.deg2rad(_WIDE_DEG) / 2)
    K = np.array([[focal_px, 0, width_px / 2], [0, focal_px, height_px / 2], [0, 0, 1]])
    return Camera(K, width_px, height_px, camera_pose([-_BACK_M, 0, _UP_M], pitch_rad=np.deg2rad(_DOWN_DEG)))


def overview(
    gaussians: Gaussians,
    predictions: Mapping[str, Boxes3D],
    truth: Boxes3D | None = None,
    *,
    title: str = "",
    width_px: int = 1200,
) -> UInt8[np.ndarray, "h w 3"]:
    """One picture per set of predictions, below each other: the cloud, truth red, predictions green.

    Args:
        gaussians: of the frame. What is higher than a few metres is left out: sky and tree tops hide the street from above.
        predictions: name -> boxes in the ego frame, in the order from top to bottom; drop unlikely ones before.
        truth: boxes in the ego frame.
        title: line above.
        width_px: of the whole.
    """
    camera = overview_camera(width_px, width_px * 2 // 5)
    low = gaussians[gaussians.centre_m[:, 2] < _CEILING_M]
    # seen from elsewhere than the cameras that measured them, points stand apart, far ones more: enlarged they close gaps
    wide = _MIN_STD_M + _STD_PER_M * np.linalg.norm(low.centre_m, axis=1)
    (view,) = render(Gaussians(low.centre_m, np.maximum(low.std_m, wide.astype(np.float32)), low.rgb), [camera])
    panels = []
    for name, boxes in predictions.items():
        image = view.rgb if truth is None else draw_boxes(view.rgb, camera, truth, TRUTH)
        panels.append(Panel(draw_boxes(image, camera, boxes, PREDICTION), f"{name}: {len(boxes)} boxes"))
    legend = [("predictions", PREDICTION)] if truth is None else [("truth", TRUTH), ("predictions", PREDICTION)]
    return sheet(panels, 1, width_px, title, legend)
