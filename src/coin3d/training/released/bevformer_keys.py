"""The released BEVFormer-tiny weights under our names (spec detectors 2, Checkpoints)."""

from __future__ import annotations

import re
from collections.abc import Mapping

from torch import Tensor

from coin3d.training.released.box_rows import our_box_rows
from coin3d.training.released.key_map import KeyMap

_HEAD = r"pts_bbox_head\."
_TRANSFORMER = _HEAD + r"transformer\."
_LAYER = _TRANSFORMER + r"(encoder|decoder)\.layers\.(\d+)\."
_ENCODER = _TRANSFORMER + r"encoder\.layers\.(\d+)\."
_DECODER = _TRANSFORMER + r"decoder\.layers\.(\d+)\."
_SAMPLING = r"(sampling_offsets|attention_weights|value_proj|output_proj)\.(weight|bias)"
_ATTENTION = {
    "sampling_offsets": "plan.offsets",
    "attention_weights": "plan.weights",
    "value_proj": "value",
    "output_proj": "output",
}
_LAST_BOX_LAYER = re.compile(r"decoder\.box_branches\.\d+\.4\.(weight|bias)")


BEVFORMER_KEYS = KeyMap(
    "the released BEVFormer-tiny",
    (
        (r"img_backbone\.(.+)", r"backbone.trunk.\1"),
        (r"img_neck\.lateral_convs\.0\.conv\.(.+)", r"neck.lateral_convs.0.\1"),
        (r"img_neck\.fpn_convs\.0\.conv\.(.+)", r"neck.out_conv.\1"),
        (_HEAD + r"bev_embedding\.weight", "bev_queries"),
        (_HEAD + r"positional_encoding\.row_embed\.weight", "bev_position.rows"),
        (_HEAD + r"positional_encoding\.col_embed\.weight", "bev_position.columns"),
        (_HEAD + r"query_embedding\.weight", "decoder.queries"),
        (_HEAD + r"cls_branches\.(.+)", r"decoder.class_branches.\1"),
        (_HEAD + r"reg_branches\.(.+)", r"decoder.box_branches.\1"),
        (_TRANSFORMER + r"level_embeds", "released.level_embedding"),
        (_TRANSFORMER + r"cams_embeds", "released.camera_embedding"),
        (_TRANSFORMER + r"can_bus_mlp\.norm\.(.+)", r"released.bus_mlp.4.\1"),
        (_TRANSFORMER + r"can_bus_mlp\.([02]\..+)", r"released.bus_mlp.\1"),
        (_TRANSFORMER + r"reference_points\.(.+)", r"decoder.start.\1"),
        (_LAYER + r"ffns\.0\.layers\.0\.0\.(.+)", r"\1.layers.\2.ffn.0.\3"),
        (_LAYER + r"ffns\.0\.layers\.1\.(.+)", r"\1.layers.\2.ffn.3.\3"),
        (_LAYER + r"norms\.(.+)", r"\1.layers.\2.norms.\3"),
        (
            _ENCODER + r"attentions\.0\." + _SAMPLING,
            lambda m: f"encoder.layers.{m[1]}.temporal.{_ATTENTION[m[2]]}.{m[3]}",
        ),
        (
            _ENCODER + r"attentions\.1\.(?:deformable_attention\.)?" + _SAMPLING,
            lambda m: f"encoder.layers.{m[1]}.spatial.{_ATTENTION[m[2]]}.{m[3]}",
        ),
        (_DECODER + r"attentions\.0\.attn\.(.+)", r"decoder.layers.\1.self_attention.\2"),
        (
            _DECODER + r"attentions\.1\." + _SAMPLING,
            lambda m: f"decoder.layers.{m[1]}.cross_attention.{_ATTENTION[m[2]]}.{m[3]}",
        ),
    ),
    ((_HEAD + r"code_weights", "weights of the box loss, part of the recipe and not of the network"),),
)
"""Names of ``BEVFormer(BEVFormerConfig.released_nuscenes(), ...)``."""


def bevformer_in_our_coding(weights: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Renamed weights with the last layer of each box branch turned to our coding of boxes."""
    return {
        name: our_box_rows(tensor, "width-length") if _LAST_BOX_LAYER.fullmatch(name) else tensor
        for name, tensor in weights.items()
    }
