"""Weights of Megvii's released BEVDepth (spec detectors 1, Checkpoints): one or two frames, with depth aggregation or without.

Boxes need no turning: the head already codes centre, log of length, width and height, sine and cosine of the heading from +x.
Files of averaged weights (``_ema``) hold the same names.
"""

from __future__ import annotations

from coin3d.methods import DirectOptions
from coin3d.methods.released_camera_numbers import ReleasedCameraNumbers
from coin3d.training.released.key_map import KeyMap

_FILE = r"(?:model\.)?"
"""The files are of a training framework that puts the network into a field of its own."""
_BACKBONE = _FILE + r"backbone\."
_DEPTH = _BACKBONE + r"depth_net\."
_DILATED = _DEPTH + r"depth_conv\.3\."
_OURS_DILATED = "depth_net.depth_conv.3."
_GATHER = _BACKBONE + r"depth_aggregation_net\."
_HEAD = _FILE + r"head\."
_TASK = _HEAD + r"task_heads\.(\d+)\."
_BRANCHES = {"reg": "offset", "height": "height", "dim": "size", "rot": "heading", "vel": "velocity", "heatmap": "heatmap"}

MEGVII_KEYS = KeyMap(
    "Megvii's released BEVDepth",
    (
        (_BACKBONE + r"img_backbone\.(.+)", r"backbone.trunk.\1"),
        (_BACKBONE + r"img_neck\.deblocks\.(.+)", r"neck.branches.\1"),
        (_DEPTH + r"bn\.(.+)", r"depth_net.vector_norm.\1"),
        (_DEPTH + r"(depth|context)_mlp\.fc1\.(.+)", r"depth_net.\1_gate.mlp.0.\2"),
        (_DEPTH + r"(depth|context)_mlp\.fc2\.(.+)", r"depth_net.\1_gate.mlp.2.\2"),
        (_DEPTH + r"(depth|context)_se\.conv_(reduce|expand)\.(.+)", r"depth_net.\1_gate.\2.\3"),
        *(
            rule
            for branch in range(4)
            for rule in (
                (_DILATED + rf"aspp{branch + 1}\.atrous_conv\.(.+)", _OURS_DILATED + rf"branches.{branch}.0.\1"),
                (_DILATED + rf"aspp{branch + 1}\.bn\.(.+)", _OURS_DILATED + rf"branches.{branch}.1.\1"),
            )
        ),
        (_DILATED + r"global_avg_pool\.1\.(.+)", _OURS_DILATED + r"global_branch.1.0.\1"),
        (_DILATED + r"global_avg_pool\.2\.(.+)", _OURS_DILATED + r"global_branch.1.1.\1"),
        (_DILATED + r"conv1\.(.+)", _OURS_DILATED + r"mix.0.0.\1"),
        (_DILATED + r"bn1\.(.+)", _OURS_DILATED + r"mix.0.1.\1"),
        (_DEPTH + r"depth_conv\.4\.conv_offset\.(.+)", r"depth_net.depth_conv.4.offset.\1"),
        (_DEPTH + r"(.+)", r"depth_net.\1"),
        (_GATHER + r"reduce_conv\.(.+)", r"aggregation.reduce.\1"),
        (_GATHER + r"conv\.([01])\.(.+)", r"aggregation.refine.0.\1.\2"),
        (_GATHER + r"conv\.3\.(.+)", r"aggregation.refine.1.0.\1"),
        (_GATHER + r"conv\.4\.(.+)", r"aggregation.refine.1.1.\1"),
        (_GATHER + r"out_conv\.0\.(.+)", r"aggregation.out.\1"),
        (_HEAD + r"trunk\.conv1\.(.+)", r"bev_encoder.stem.0.\1"),
        (_HEAD + r"trunk\.bn1\.(.+)", r"bev_encoder.stem.1.\1"),
        *((_HEAD + rf"trunk\.layer{stage + 1}\.(.+)", rf"bev_encoder.stages.{stage}.\1") for stage in range(3)),
        (_HEAD + r"neck\.deblocks\.(.+)", r"bev_encoder.neck.branches.\1"),
        (_HEAD + r"shared_conv\.conv\.(.+)", r"head.shared_conv.0.\1"),
        (_HEAD + r"shared_conv\.bn\.(.+)", r"head.shared_conv.1.\1"),
        *(
            rule
            for theirs, ours in _BRANCHES.items()
            for rule in (
                (_TASK + rf"{theirs}\.0\.conv\.(.+)", rf"head.tasks.\1.{ours}.0.0.\2"),
                (_TASK + rf"{theirs}\.0\.bn\.(.+)", rf"head.tasks.\1.{ours}.0.1.\2"),
                (_TASK + rf"{theirs}\.1\.(.+)", rf"head.tasks.\1.{ours}.1.\2"),
            )
        ),
    ),
    (
        (_BACKBONE + r"voxel_(?:size|coord|num)", "the grid, which is part of the configuration"),
        (_BACKBONE + r"frustum", "computed from the input size and the depth bins"),
    ),
)
"""Every weight has a place; only what the configuration says already is left out."""


def megvii_options() -> DirectOptions:
    """The method those weights were trained with: the depth net is told the camera's numbers."""
    return DirectOptions(released=ReleasedCameraNumbers())
