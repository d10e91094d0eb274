"""Weights of the authors' released CoIn3D detector (BEVDepth paradigm, two frames; spec detectors 0)."""

from __future__ import annotations

from coin3d.detectors import BEVDepthConfig
from coin3d.detectors.center_decode import DecodeOptions
from coin3d.methods import CoIn3DOptions
from coin3d.priors.released import ReleasedConventions
from coin3d.training.released.key_map import KeyMap


def released_config(
    conventions: ReleasedConventions, height_px: int = 384, nms_size_factors: tuple[float, ...] = (1.0,)
) -> BEVDepthConfig:
    """The detector those weights belong to: 704 pixels wide, 384 high for nuScenes, 320 for Waymo and the mix."""
    return BEVDepthConfig(
        image_height_px=height_px,
        depth_channels=521,
        frames=2,
        frame_blocks=2,
        previous_by="warp",
        decode=DecodeOptions(nms_size_factors=nms_size_factors),
        released=conventions,
    )


def released_options(conventions: ReleasedConventions) -> CoIn3DOptions:
    """The method those weights were trained with."""
    return CoIn3DOptions(released=conventions)


_DEPTH = r"img_view_transformer\.depth_net\."
_HEAD = r"pts_bbox_head\.task_heads\.0\."
_BRANCHES = {"reg": "offset", "height": "height", "dim": "size", "rot": "heading", "heatmap": "heatmap"}

COIN3D_KEYS = KeyMap(
    "the released CoIn3D detector",
    (
        (r"img_backbone\.(.+)", r"backbone.trunk.\1"),
        (r"img_neck\.lateral_convs\.(\d)\.conv\.(.+)", r"neck.lateral_convs.\1.\2"),
        (r"img_neck\.fpn_convs\.0\.conv\.(.+)", r"neck.out_conv.\1"),
        (
            r"prior_modulate_layer_(backbone_\d+)x\.perspective_modulate_conv\.0\.weight",
            r"method.modulations.\1.projector.0.weight",
        ),
        (r"prior_modulate_layer_neck\.perspective_modulate_conv\.0\.weight", r"method.modulations.neck.projector.0.weight"),
        (_DEPTH + r"bn\.(.+)", r"depth_net.vector_norm.\1"),
        (_DEPTH + r"(depth|context)_mlp\.fc1\.(.+)", r"depth_net.\1_gate.mlp.0.\2"),
        (_DEPTH + r"(depth|context)_mlp\.fc2\.(.+)", r"depth_net.\1_gate.mlp.2.\2"),
        (_DEPTH + r"(depth|context)_se\.conv_(reduce|expand)\.(.+)", r"depth_net.\1_gate.\2.\3"),
        (_DEPTH + r"depth_conv\.3\.aspp1\.atrous_conv\.(.+)", r"depth_net.depth_conv.3.branches.0.0.\1"),
        (_DEPTH + r"depth_conv\.3\.aspp1\.bn\.(.+)", r"depth_net.depth_conv.3.branches.0.1.\1"),
        *(
            rule
            for number in (2, 3, 4)
            for rule in (
                (
                    _DEPTH + rf"depth_conv\.3\.aspp{number}\.atrous_conv\.(.+)",
                    rf"depth_net.depth_conv.3.branches.{number - 1}.0.\1",
                ),
                (_DEPTH + rf"depth_conv\.3\.aspp{number}\.bn\.(.+)", rf"depth_net.depth_conv.3.branches.{number - 1}.1.\1"),
            )
        ),
        (_DEPTH + r"depth_conv\.3\.global_avg_pool\.1\.(.+)", r"depth_net.depth_conv.3.global_branch.1.0.\1"),
        (_DEPTH + r"depth_conv\.3\.global_avg_pool\.2\.(.+)", r"depth_net.depth_conv.3.global_branch.1.1.\1"),
        (_DEPTH + r"depth_conv\.3\.conv1\.(.+)", r"depth_net.depth_conv.3.mix.0.0.\1"),
        (_DEPTH + r"depth_conv\.3\.bn1\.(.+)", r"depth_net.depth_conv.3.mix.0.1.\1"),
        (_DEPTH + r"(.+)", r"depth_net.\1"),
        (r"pre_process_net\.layers\.0\.(.+)", r"frame_encoder.\1"),
        (r"img_bev_encoder_backbone\.layers\.(.+)", r"bev_encoder.stages.\1"),
        (r"img_bev_encoder_neck\.conv\.([01])\.(.+)", r"bev_encoder.merge.0.\1.\2"),
        (r"img_bev_encoder_neck\.conv\.3\.(.+)", r"bev_encoder.merge.1.0.\1"),
        (r"img_bev_encoder_neck\.conv\.4\.(.+)", r"bev_encoder.merge.1.1.\1"),
        (r"img_bev_encoder_neck\.up2\.1\.(.+)", r"bev_encoder.lift_fine.1.0.\1"),
        (r"img_bev_encoder_neck\.up2\.2\.(.+)", r"bev_encoder.lift_fine.1.1.\1"),
        (r"img_bev_encoder_neck\.up2\.4\.(.+)", r"bev_encoder.lift_fine.2.\1"),
        (r"pts_bbox_head\.shared_conv\.conv\.(.+)", r"head.shared_conv.0.\1"),
        (r"pts_bbox_head\.shared_conv\.bn\.(.+)", r"head.shared_conv.1.\1"),
        *(
            rule
            for theirs, ours in _BRANCHES.items()
            for rule in (
                (_HEAD + rf"{theirs}\.0\.conv\.(.+)", rf"head.branches.{ours}.0.0.\1"),
                (_HEAD + rf"{theirs}\.0\.bn\.(.+)", rf"head.branches.{ours}.0.1.\1"),
                (_HEAD + rf"{theirs}\.1\.(.+)", rf"head.branches.{ours}.1.\1"),
            )
        ),
    ),
)
"""Every weight has a place; nothing is left out."""
