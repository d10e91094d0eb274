"""Detectors: each is one file, built from the parts beside it, and reached by methods through ``method.Method`` only."""

from coin3d.detectors.batch import Batch
from coin3d.detectors.bevdepth import BEVDepth
from coin3d.detectors.bevdepth_config import BEVDepthConfig
from coin3d.detectors.bevformer import BEVFormer
from coin3d.detectors.bevformer_config import BEVFormerConfig
from coin3d.detectors.detector import Detector
from coin3d.detectors.inputs import Sample, collate, frame_sample
from coin3d.detectors.method import Method
from coin3d.detectors.petr import PETR
from coin3d.detectors.petr_config import PETRConfig
from coin3d.detectors.trunk import TrunkConfig, TrunkPretraining

DETECTORS = {"bevdepth": (BEVDepthConfig, BEVDepth), "bevformer": (BEVFormerConfig, BEVFormer), "petr": (PETRConfig, PETR)}
"""Name -> (configuration class, detector class)."""

TRAINABLE = {**DETECTORS, "trunk": (TrunkConfig, TrunkPretraining)}
"""What ``coin3d train`` and ``coin3d pretrain`` can train."""

__all__ = [
    "DETECTORS",
    "PETR",
    "TRAINABLE",
    "BEVDepth",
    "BEVDepthConfig",
    "BEVFormer",
    "BEVFormerConfig",
    "Batch",
    "Detector",
    "Method",
    "PETRConfig",
    "Sample",
    "TrunkConfig",
    "TrunkPretraining",
    "collate",
    "frame_sample",
]
