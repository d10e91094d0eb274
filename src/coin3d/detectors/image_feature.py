"""What all detectors share: images through trunk and neck, with the method's hooks at every level."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from torch import Tensor

from coin3d.detectors.backbone import ImageBackbone
from coin3d.detectors.batch import Batch
from coin3d.detectors.method import Method
from coin3d.detectors.neck import FeaturePyramid
from coin3d.detectors.second_fpn import SecondFPN
from coin3d.detectors.vovnet import VoVNet99


def attach_neck(
    method: Method, backbone: ImageBackbone | VoVNet99, strides: Sequence[int], channels: int
) -> tuple[FeaturePyramid, int]:
    """A neck on the trunk's levels as the method leaves them.

    Returns:
        The neck, and the channels of its feature behind the method's own hook there.
    """
    neck = FeaturePyramid(attach_levels(method, backbone, strides), channels)
    return neck, method.attach("neck", channels, strides[0])


def attach_levels(method: Method, backbone: ImageBackbone | VoVNet99, strides: Sequence[int]) -> list[int]:
    """Channels of the trunk's levels as the method leaves them."""
    levels = zip(strides, backbone.channels, strict=True)
    return [method.attach(f"backbone_{stride}", inputs, stride) for stride, inputs in levels]


def image_feature(
    method: Method,
    backbone: ImageBackbone | VoVNet99,
    neck: FeaturePyramid | SecondFPN,
    strides: Sequence[int],
    batch: Batch,
) -> tuple[Tensor, Any]:
    """The feature of every image (M, C, h, w) at the finest stride, and the method's context of this forward."""
    context = method.prepare(batch.cameras)
    features = backbone(method.image(batch.images, context))
    modulated = [method.modulate(f"backbone_{stride}", x, context) for stride, x in zip(strides, features, strict=True)]
    return method.modulate("neck", neck(modulated), context), context
