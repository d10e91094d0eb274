"""Auxiliary supervision of the image trunk: which image cells show an object, and how it lies there.

A trunk that starts from random weights gets little to go on through the lift: its features reach the boxes only after depth is
right. Telling each image cell directly what it shows is the perspective supervision of BEVFormer v2, reduced to one small head.
It looks at the image alone: nothing it predicts depends on where the camera is mounted or how long its lens is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from coin3d.augmentation import transform_boxes
from coin3d.detectors.batch import Batch
from coin3d.detectors.layers import conv_bn_relu
from coin3d.geometry import Boxes3D
from coin3d.geometry.camera_tensors import CameraTensors

_REGRESSIONS = 5
"""Centre in the image 2, log apparent distance 1, heading relative to the ray 2."""
_NEAREST_M = 0.5
_REFERENCE_M = 25.0
"""Apparent distances (depth x image width / focal length) are relative to this: about 18 m through a lens of 70 degrees."""
_COVER_WEIGHT = 15.0
_LARGEST_LOG = 3.0  # half a kilometre through the reference lens: what is read off an untrained head stays finite


@dataclass(frozen=True)
class PerspectiveTargets:
    """What each image cell shows.

    Args:
        cover: (M, h, w) share of the cell covered by outlines of objects.
        object: (M, h, w) whether the cell's centre lies on one.
        values: (M, 5, h, w) of the nearest object there: its projected centre relative to the cell, in pairs of cells, two;
            twice the log of its apparent distance; sine and cosine of its heading relative to the cell's ray.
    """

    cover: Float[Tensor, "m h w"]
    object: Bool[Tensor, "m h w"]
    values: Float[Tensor, "m 5 h w"]


class PerspectiveHead(nn.Module):
    """Predicts ``PerspectiveTargets`` from the neck's feature: one 3x3 convolution and an output layer."""

    def __init__(self, inputs: int, channels: int) -> None:
        super().__init__()
        self.conv = conv_bn_relu(inputs, channels)
        self.output = nn.Conv2d(channels, 1 + _REGRESSIONS, 1)

    def forward(self, feature: Float[Tensor, "m c h w"]) -> Float[Tensor, "m 6 h w"]:
        """Cover logits, then the values."""
        out: Tensor = self.output(self.conv(feature))
        return out

    def loss(self, shown: Float[Tensor, "m 6 h w"], targets: PerspectiveTargets) -> Float[Tensor, ""]:
        """See ``perspective_loss``."""
        return perspective_loss(shown, targets)


def scaled_log_distance(apparent_m: float) -> float:
    """How an apparent distance is told, see ``PerspectiveTargets``."""
    return 2 * math.log(apparent_m / _REFERENCE_M)


def perspective_loss(predicted: Float[Tensor, "m 6 h w"], targets: PerspectiveTargets) -> Float[Tensor, ""]:
    """Cross-entropy of the cover over all cells, and an L1 of the values over cells that show an object."""
    predicted = predicted.float()
    cover = F.binary_cross_entropy_with_logits(predicted[:, 0], targets.cover)
    error = (predicted[:, 1:] - targets.values).abs().sum(1) * targets.object
    return _COVER_WEIGHT * cover + error.sum() / targets.object.sum().clamp(min=1)


def lift_perspective(
    values: Float[Tensor, "m 6 h w"], cameras: CameraTensors, stride: int
) -> tuple[Float[Tensor, "m 3 h w"], Float[Tensor, "m 2 h w"]]:
    """Where the objects are that a ``PerspectiveHead`` sees: the targets read backwards.

    Args:
        values: cover logits and the values, of M cameras.
        cameras: the cameras of the network images.
        stride: pixels per cell.

    Returns:
        Centres in the ego frame in metres, and cosine and sine of the yaw in the ego frame (of no particular length).
    """
    h, w = values.shape[-2:]
    rows, columns = (torch.arange(n, device=values.device, dtype=values.dtype) + 0.5 for n in (h, w))
    cell_px = stride * torch.stack(torch.meshgrid(columns, rows, indexing="xy"))
    centre_px = cell_px + 2 * stride * values[:, 1:3]
    focal_px = torch.linalg.det(cameras.K[:, :2, :2]).abs().sqrt()
    apparent_m = _REFERENCE_M * (values[:, 3] / 2).clamp(-_LARGEST_LOG, _LARGEST_LOG).exp()
    depth_m = apparent_m * (focal_px / cameras.width_px)[:, None, None]
    ego_from_image = cameras.ego_from_cam[:, :3, :3] @ torch.linalg.inv(cameras.K)

    def ray(pixel: Float[Tensor, "... 2 h w"]) -> Float[Tensor, "m 3 h w"]:
        homogeneous = torch.cat([pixel, torch.ones_like(pixel[..., :1, :, :])], dim=-3).expand(len(values), 3, h, w)
        return torch.einsum("mij,mjhw->mihw", ego_from_image, homogeneous)

    centre_m = ray(centre_px) * depth_m[:, None] + cameras.ego_from_cam[:, :3, 3, None, None]
    x, y = F.normalize(ray(cell_px)[:, :2], dim=1).unbind(1)
    sine, cosine = values[:, 4], values[:, 5]
    return centre_m, torch.stack([cosine * x - sine * y, cosine * y + sine * x], dim=1)


def perspective_batch_targets(batch: Batch, stride: int) -> PerspectiveTargets:
    """Targets of a training batch: its boxes without their BEV augmentation, each camera with those of its sample."""
    ego_from_bev = torch.linalg.inv(batch.bev_from_ego).cpu().double().numpy()
    in_ego = [transform_boxes(boxes, t) for boxes, t in zip(batch.boxes, ego_from_bev, strict=True)]
    return perspective_targets([in_ego[i] for i in batch.sample_index.tolist()], batch.cameras, stride)


def perspective_targets(boxes: list[Boxes3D], cameras: CameraTensors, stride: int) -> PerspectiveTargets:
    """Targets of M cameras.

    Args:
        boxes: M tables in the ego frame, one per camera (cameras of a sample share theirs).
        cameras: the cameras of the network images.
        stride: pixels per cell.
    """
    K = cameras.K.cpu().double().numpy()
    ego_from_cam = cameras.ego_from_cam.cpu().double().numpy()
    size_px = cameras.width_px, cameras.height_px
    found = [_camera_targets(*row, size_px, stride) for row in zip(boxes, K, ego_from_cam, strict=True)]
    cover, owned, values = (torch.from_numpy(np.stack(parts)).to(cameras.K.device) for parts in zip(*found, strict=True))
    return PerspectiveTargets(cover, owned, values)


def _camera_targets(
    boxes: Boxes3D,
    K: Float[np.ndarray, "3 3"],
    ego_from_cam: Float[np.ndarray, "4 4"],
    size_px: tuple[int, int],
    stride: int,
) -> tuple[Float[np.ndarray, "h w"], Bool[np.ndarray, "h w"], Float[np.ndarray, "5 h w"]]:
    width_px, height_px = size_px
    rotation, origin = ego_from_cam[:3, :3], ego_from_cam[:3, 3]
    corners_cam = (boxes.corners() - origin) @ rotation
    centres_cam = (boxes.centre_m - origin) @ rotation
    # an outline is drawn only where the whole box is in front of the camera: behind it, there is none
    in_front = np.flatnonzero((corners_cam[..., 2] > _NEAREST_M).all(1))
    owner = np.full((height_px, width_px), -1, dtype=np.int32)
    for i in in_front[np.argsort(-centres_cam[in_front, 2], kind="stable")]:  # the nearest is drawn last
        pixels = corners_cam[i] @ K.T
        outline = cv2.convexHull((pixels[:, :2] / pixels[:, 2:]).astype(np.float32))
        cv2.fillConvexPoly(owner, np.round(np.clip(outline, -20_000, 20_000)).astype(np.int32), int(i))
    h, w = height_px // stride, width_px // stride
    cover = cv2.resize((owner >= 0).astype(np.float32), (w, h), interpolation=cv2.INTER_AREA)
    nearest = owner[stride // 2 :: stride, stride // 2 :: stride][:h, :w]
    values = np.zeros((_REGRESSIONS, h, w), dtype=np.float32)
    row, column = np.nonzero(nearest >= 0)
    i = nearest[row, column]
    cell_px = (np.stack([column, row], axis=1) + 0.5) * stride
    centre_px = (centres_cam[i] / centres_cam[i, 2:]) @ K[:2].T
    values[:2, row, column] = ((centre_px - cell_px) / (2 * stride)).T
    focal_px = np.sqrt(abs(np.linalg.det(K[:2, :2])))
    values[2, row, column] = 2 * np.log(centres_cam[i, 2] * width_px / focal_px / _REFERENCE_M)
    ray = np.concatenate([cell_px, np.ones((len(cell_px), 1))], axis=1) @ np.linalg.inv(K).T @ rotation.T
    seen_from = boxes.yaw_rad[i] - np.arctan2(ray[:, 1], ray[:, 0])
    values[3:, row, column] = np.sin(seen_from), np.cos(seen_from)
    return cover, nearest >= 0, values
