"""The released BEVFormer-tiny weights under our names (spec detectors 2, Checkpoints)."""

from __future__ import annotations

import re
from collections.abc import Mapping

import torch
from jaxtyping import Shaped
from torch import Tensor

LEFT_OUT = {"pts_bbox_head.code_weights": "weights of the box loss, part of the recipe and not of the network"}
"""Released keys that are not loaded, and why."""

_HEAD = r"pts_bbox_head\."
_TRANSFORMER = _HEAD + r"transformer\."
_LAYER = _TRANSFORMER + r"(encoder|decoder)\.layers\.(\d+)\."
_RENAMED = (
    (r"img_backbone\.", "backbone.trunk."),
    (r"img_neck\.lateral_convs\.0\.conv\.", "neck.lateral_convs.0."),
    (r"img_neck\.fpn_convs\.0\.conv\.", "neck.out_conv."),
    (_HEAD + r"bev_embedding\.weight", "bev_queries"),
    (_HEAD + r"positional_encoding\.row_embed\.weight", "bev_position.rows"),
    (_HEAD + r"positional_encoding\.col_embed\.weight", "bev_position.columns"),
    (_HEAD + r"query_embedding\.weight", "decoder.queries"),
    (_HEAD + r"cls_branches\.", "decoder.class_branches."),
    (_HEAD + r"reg_branches\.", "decoder.box_branches."),
    (_TRANSFORMER + r"level_embeds", "released.level_embedding"),
    (_TRANSFORMER + r"cams_embeds", "released.camera_embedding"),
    (_TRANSFORMER + r"can_bus_mlp\.norm\.", "released.bus_mlp.4."),
    (_TRANSFORMER + r"can_bus_mlp\.(0|2)\.", r"released.bus_mlp.\1."),
    (_TRANSFORMER + r"reference_points\.", "decoder.start."),
    (_LAYER + r"ffns\.0\.layers\.0\.0\.", r"\1.layers.\2.ffn.0."),
    (_LAYER + r"ffns\.0\.layers\.1\.", r"\1.layers.\2.ffn.3."),
    (_LAYER + r"norms\.", r"\1.layers.\2.norms."),
    (_TRANSFORMER + r"encoder\.layers\.(\d+)\.attentions\.0\.", r"encoder.layers.\1.temporal."),
    (_TRANSFORMER + r"encoder\.layers\.(\d+)\.attentions\.1\.(?:deformable_attention\.)?", r"encoder.layers.\1.spatial."),
    (_TRANSFORMER + r"decoder\.layers\.(\d+)\.attentions\.0\.attn\.", r"decoder.layers.\1.self_attention."),
    (_TRANSFORMER + r"decoder\.layers\.(\d+)\.attentions\.1\.", r"decoder.layers.\1.cross_attention."),
)
_ATTENTION = {
    "sampling_offsets": "plan.offsets",
    "attention_weights": "plan.weights",
    "value_proj": "value",
    "output_proj": "output",
}
_LAST_BOX_LAYER = re.compile(r"decoder\.box_branches\.\d+\.4\.(weight|bias)")


def bevformer_name(released: str) -> str | None:
    """Our name of a released key; None for a key that is not one of BEVFormer-tiny's, or is in ``LEFT_OUT``."""
    if released in LEFT_OUT:
        return None
    for pattern, name in _RENAMED:
        if match := re.match(pattern, released):
            ours = match.expand(name) + released[match.end() :]
            stem, _, last = ours.rpartition(".")
            parent, _, layer = stem.rpartition(".")
            return f"{parent}.{_ATTENTION[layer]}.{last}" if layer in _ATTENTION else ours
    return None


def bevformer_weights(released: Mapping[str, Tensor], expected: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Released weights as a state dict of ``BEVFormer(BEVFormerConfig.released_nuscenes(), ...)``.

    The rows of the box branches are turned to our coding, so that the boxes come out as all detectors' do: length before
    width, heading counter-clockwise from +x.

    Args:
        released: the file's ``state_dict``.
        expected: ``state_dict()`` of the detector.

    Raises:
        ValueError: a key that does not belong to it, that is missing, or of another shape; it is named.
    """
    renamed: dict[str, Tensor] = {}
    released_names: dict[str, str] = {}
    for key, tensor in released.items():
        if key in LEFT_OUT:
            continue
        ours = bevformer_name(key)
        if ours is None or ours not in expected:
            raise ValueError(f"'{key}' is no weight of BEVFormer-tiny: is this file of another network?")
        if tensor.shape != expected[ours].shape:
            raise ValueError(f"'{key}' has shape {tuple(tensor.shape)}, BEVFormer-tiny needs {tuple(expected[ours].shape)}")
        renamed[ours], released_names[ours] = tensor, key
    if missing := [name for name in expected if name not in renamed]:
        raise ValueError(f"the file lacks the weight that becomes '{missing[0]}' ({len(missing)} are missing)")
    return {name: box_rows(tensor) if _LAST_BOX_LAYER.fullmatch(name) else tensor for name, tensor in renamed.items()}


def box_rows(rows: Shaped[Tensor, "10 *rest"]) -> Shaped[Tensor, "10 *rest"]:
    """Rows of a released box layer in our coding: width and length change places, yaw = -yaw_released - pi / 2."""
    return torch.stack([*rows[:2], rows[3], rows[2], *rows[4:6], -rows[7], -rows[6], *rows[8:]])
