"""PETR-VoV: which released weight becomes which of ours, and what is rearranged on the way (spec detectors 2, 3)."""

from __future__ import annotations

from collections.abc import Mapping

from torch import Tensor

from coin3d.training.released.box_rows import SizeOrder, our_box_rows
from coin3d.training.released.key_map import KeyMap

_PARTS = {"conv": 0, "norm": 1}
_FEED_FORWARD = {"0.0": 0, "1": 3}
_STAGE = r"img_backbone\.stage([2-5])\.OSA\1_(\d)\."
_HEAD = r"pts_bbox_head\."
_LAYER = _HEAD + r"transformer\.decoder\.layers\.(\d+)\."

PETR_KEYS = KeyMap(
    "the released PETR-VoV",
    (
        (
            r"img_backbone\.stem\.stem_([123])/(conv|norm)\.(.+)",
            lambda m: f"backbone.stem.{int(m[1]) - 1}.{_PARTS[m[2]]}.{m[3]}",
        ),
        (
            _STAGE + r"layers\.(\d)\.OSA\1_\2_\3/(conv|norm)\.(.+)",
            lambda m: f"backbone.stages.{int(m[1]) - 2}.{int(m[2]) - 1}.layers.{m[3]}.{_PARTS[m[4]]}.{m[5]}",
        ),
        (
            _STAGE + r"concat\.OSA\1_\2_concat/(conv|norm)\.(.+)",
            lambda m: f"backbone.stages.{int(m[1]) - 2}.{int(m[2]) - 1}.join.{_PARTS[m[3]]}.{m[4]}",
        ),
        (_STAGE + r"ese\.fc\.(.+)", lambda m: f"backbone.stages.{int(m[1]) - 2}.{int(m[2]) - 1}.gate.{m[3]}"),
        (r"img_neck\.lateral_convs\.(\d)\.conv\.(.+)", r"neck.lateral_convs.\1.\2"),
        (r"img_neck\.fpn_convs\.0\.conv\.(.+)", r"neck.out_conv.\1"),
        (_HEAD + r"((?:input_proj|query_embedding)\..+)", r"\1"),
        (_HEAD + r"position_encoder\.(.+)", r"rays.mlp.\1"),
        (_HEAD + r"adapt_pos3d\.(.+)", r"camera_sine.mlp.\1"),
        (_HEAD + r"reference_points\.weight", "reference_points"),
        (_HEAD + r"cls_branches\.[0-5]\.(.+)", r"class_branch.\1"),  # all decoder layers share one branch
        (_HEAD + r"reg_branches\.[0-5]\.(.+)", r"box_branch.\1"),
        (_LAYER + r"attentions\.0\.attn\.(.+)", r"decoder.layers.\1.among_queries.\2"),
        (_LAYER + r"attentions\.1\.attn\.(.+)", r"decoder.layers.\1.to_memory.\2"),
        (
            _LAYER + r"ffns\.0\.layers\.(0\.0|1)\.(.+)",
            lambda m: f"decoder.layers.{m[1]}.feed_forward.{_FEED_FORWARD[m[2]]}.{m[3]}",
        ),
        (_LAYER + r"norms\.(.+)", r"decoder.layers.\1.norms.\2"),
        (_HEAD + r"transformer\.decoder\.post_norm\.(.+)", r"decoder.norm.\1"),
    ),
    ((_HEAD + r"code_weights", "weights of the box loss, part of the recipe and not of the network"),),
)
"""Names of ``PETR(PETRConfig.released_nuscenes(), ...)``."""


def petr_in_our_conventions(weights: Mapping[str, Tensor], sizes: SizeOrder) -> dict[str, Tensor]:
    """Renamed weights for RGB images, with boxes coded as ours and sines that alternate with cosines.

    Args:
        weights: with our names and the released numbers.
        sizes: the authors' file stores width before length, the port to mmdet3d length before width.
    """
    first, sine = "backbone.stem.0.0.weight", "camera_sine.mlp.0.weight"
    boxes = ("box_branch.4.weight", "box_branch.4.bias")
    # of camera, row and column the released code lists all sines, then all cosines
    of_three = weights[sine].reshape(len(weights[sine]), 3, 2, -1)
    return {
        **weights,
        **{name: our_box_rows(weights[name], sizes) for name in boxes},
        first: weights[first].flip(1),
        sine: of_three.transpose(2, 3).reshape(weights[sine].shape),
    }
