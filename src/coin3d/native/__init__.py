"""C++17 kernels with numpy at the border. Each has a plain reference beside its Python caller; this folder imports nothing."""

from coin3d.native._native import (
    TsdfVolume,
    bev_pool_backward,
    bev_pool_forward,
    fill_holes,
    marching_cubes,
    match_boxes,
    rotated_iou,
    rotated_nms,
    splat_bounds,
    splat_chunk,
    splat_instruction_sets,
    splat_render,
)

__all__ = [
    "TsdfVolume",
    "bev_pool_backward",
    "bev_pool_forward",
    "fill_holes",
    "marching_cubes",
    "match_boxes",
    "rotated_iou",
    "rotated_nms",
    "splat_bounds",
    "splat_chunk",
    "splat_instruction_sets",
    "splat_render",
]
